"""A run of SLAM in its middle as plain arrays, and back."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from meshslam.geometry import Bytes, Pose
from meshslam.graph import Arrays, smoother_from_arrays, smoother_to_arrays
from meshslam.motion import NavState
from meshslam.object_slam.estimator import SlamEstimator
from meshslam.object_slam.landmarks import Landmark, OdometryFrame
from meshslam.object_slam.object_start import Candidate
from meshslam.perception import Detection

_ARRAYS = ("keypoints", "keypoint_scores", "keypoint_sigmas_px", "viewing_angle_shares")  # of a detection


def packed_json(plain: Any) -> Bytes:  # noqa: ANN401 # any JSON
    """JSON as bytes: NumPy's strings take four for each of its letters."""
    return np.frombuffer(json.dumps(plain).encode(), np.uint8)


def unpacked_json(packed: Bytes) -> Any:  # noqa: ANN401 # any JSON
    """The reverse of `packed_json`."""
    return json.loads(packed.tobytes())


def estimator_to_arrays(estimator: SlamEstimator) -> Arrays:
    """All that a run needs to go on."""
    at, road = estimator.odometry_frame, estimator.road
    plain = {
        "frame_ids": estimator.frame_ids,
        "times_s": estimator.times_s,
        "path": [estimator.path[f].matrix.tolist() for f in estimator.frame_ids],
        "moving": sorted(estimator.moving),
        "looked_at": estimator.looked_at,
        "joined": estimator.joined,
        "in_view": sorted(estimator.in_view.items()),
        "odometry_frame": {
            "pose": at.map_from_odometry.matrix.tolist(),
            "distance_m": at.distance_m,
            "drift_m": at.drift_m,
        },
        "landmarks": [_landmark_to_plain(mark) for mark in estimator.landmarks.values()],
        "candidates": [_candidate_to_plain(track, c) for track, c in estimator.candidates.items()],
        "state": state_to_plain(estimator.state),
        "road": None if road is None else [road.count, road.next_frame, road.recent],
        "motion": estimator.motion.to_plain(),
    }
    hidden = [
        np.packbits(observation.occluder) for c in estimator.candidates.values() for observation in c.observations
    ]
    return {
        "plain": packed_json(plain),
        "occluders": np.array(hidden, np.uint8),
        **smoother_to_arrays(estimator.smoother),
    }


def estimator_from_arrays(estimator: SlamEstimator, arrays: Mapping[str, Any]) -> None:
    """Fill a run that has not begun."""
    plain = unpacked_json(arrays["plain"])
    estimator.frame_ids, estimator.times_s = plain["frame_ids"], plain["times_s"]
    estimator.path = {f: _pose(matrix) for f, matrix in zip(estimator.frame_ids, plain["path"], strict=True)}
    estimator.moving, estimator.in_view = set(plain["moving"]), {t: n for t, n in plain["in_view"]}
    estimator.joined = [(new, old) for new, old in plain["joined"]]
    estimator.looked_at = plain["looked_at"]
    at = plain["odometry_frame"]
    estimator.odometry_frame = OdometryFrame(_pose(at["pose"]), at["distance_m"], at["drift_m"])
    estimator.landmarks = {mark["number"]: _landmark(mark) for mark in plain["landmarks"]}
    estimator.state = state_from_plain(plain["state"])
    if estimator.road is not None and plain["road"] is not None:
        estimator.road.count, estimator.road.next_frame, recent = plain["road"]
        estimator.road.recent = tuple(recent)
    estimator.motion.fill(plain["motion"])
    setup = estimator.setup
    smoother_from_arrays(estimator.smoother, arrays, setup.model, setup.noise, setup.camera)
    hidden = iter(arrays["occluders"])
    for row in plain["candidates"]:
        observations = [
            estimator.observations.of(o["index"], detection_from_plain(o["detection"]), _mask(next(hidden), estimator))
            for o in row["observations"]
        ]
        estimator.candidates[row["track"]] = Candidate(observations, row["next_try"])


def _pose(matrix: Any) -> Pose:  # noqa: ANN401 # nested lists
    return Pose.restored(np.array(matrix, float))


def _mask(packed: Bytes, estimator: SlamEstimator) -> Bytes:
    height, width = estimator.setup.camera.height, estimator.setup.camera.width
    return np.unpackbits(packed, count=height * width).reshape(height, width)


def _landmark_to_plain(mark: Landmark) -> dict[str, Any]:
    names = ("number", "track", "views", "nearest_m", "drift_m", "moves", "is_withdrawn")
    row = {name: getattr(mark, name) for name in names}
    left = mark.pose_covariance
    row |= {
        "pose_covariance": None if left is None else left.tolist(),
        "z": mark.z.tolist(),
        "dimensions": mark.dimensions.tolist(),
    }
    in_map = None if mark.in_map is None else mark.in_map.matrix.tolist()
    return row | {"world_from_object": mark.world_from_object.matrix.tolist(), "in_map": in_map}


def _landmark(row: dict[str, Any]) -> Landmark:
    arrays = {name: np.array(row[name], float) for name in ("z", "dimensions")}
    left = row.pop("pose_covariance")
    in_map = None if row["in_map"] is None else _pose(row["in_map"])
    return Landmark(
        **(row | arrays | {"world_from_object": _pose(row["world_from_object"]), "in_map": in_map}),
        pose_covariance=None if left is None else np.array(left),
    )


def _candidate_to_plain(track: int, candidate: Candidate) -> dict[str, Any]:
    observations = [{"index": s.index, "detection": detection_to_plain(s.detection)} for s in candidate.observations]
    return {"track": track, "next_try": candidate.next_try, "observations": observations}


def detection_to_plain(detection: Detection) -> dict[str, Any]:
    """A detection as JSON has it."""
    row = {f.name: getattr(detection, f.name) for f in fields(detection)}
    return row | {name: None if row[name] is None else row[name].tolist() for name in _ARRAYS}


def detection_from_plain(row: dict[str, Any]) -> Detection:
    """The reverse of `detection_to_plain`."""
    arrays = {name: None if row[name] is None else np.array(row[name], float) for name in _ARRAYS}
    return Detection(**row | arrays | {"bbox": tuple(row["bbox"]), "image_size": tuple(row["image_size"])})


def state_to_plain(state: NavState) -> dict[str, Any]:
    """A state as JSON has it."""
    return {
        "time_s": state.time_s,
        "pose": state.world_from_imu.matrix.tolist(),
        "velocity": state.velocity_in_world.tolist(),
        "biases": [*state.accelerometer_bias.tolist(), *state.gyroscope_bias.tolist()],
    }


def state_from_plain(row: dict[str, Any]) -> NavState:
    """The reverse of `state_to_plain`."""
    biases = np.array(row["biases"])
    return NavState(row["time_s"], _pose(row["pose"]), np.array(row["velocity"]), biases[:3], biases[3:])
