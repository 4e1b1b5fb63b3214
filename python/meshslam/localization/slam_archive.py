"""A run of SLAM in its middle as plain arrays, and back."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from meshslam.geometry import Pose
from meshslam.geometry.arrays import Bytes
from meshslam.localization.graph_archive import Arrays
from meshslam.localization.imu import NavState
from meshslam.localization.landmarks import Landmark, Odometer
from meshslam.localization.slam import Candidate, Slam
from meshslam.localization.smoother_archive import smoother_from_arrays, smoother_to_arrays
from meshslam.perception import Detection

_ARRAYS = ("keypoints", "keypoint_scores", "keypoint_sigmas_px", "viewing_angle_shares")  # of a detection


def slam_to_arrays(slam: Slam) -> Arrays:
    """All that a run needs to go on."""
    at = slam.odometer
    plain = {
        "frame_ids": slam.frame_ids,
        "times_s": slam.times_s,
        "path": [slam.path[f].matrix.tolist() for f in slam.frame_ids],
        "moving": sorted(slam.moving),
        "same": slam.same,
        "in_view": sorted(slam.in_view.items()),
        "odometer": {"pose": at.map_from_odometry.matrix.tolist(), "way_m": at.way_m, "known_at_m": at.known_at_m},
        "landmarks": [_landmark_to_plain(mark) for mark in slam.landmarks.values()],
        "candidates": [_candidate_to_plain(track, c) for track, c in slam.candidates.items()],
        "state": _state_to_plain(slam.state),
    }
    hidden = [np.packbits(sight.occluder) for c in slam.candidates.values() for sight in c.sights]
    return {
        "slam": np.array(json.dumps(plain)),
        "occluders": np.array(hidden, np.uint8),
        **smoother_to_arrays(slam.smoother),
    }


def slam_from_arrays(slam: Slam, arrays: Mapping[str, Any]) -> None:
    """Fill a run that has not begun."""
    plain = json.loads(str(arrays["slam"]))
    slam.frame_ids, slam.times_s = plain["frame_ids"], plain["times_s"]
    slam.path = {f: _pose(matrix) for f, matrix in zip(slam.frame_ids, plain["path"], strict=True)}
    slam.moving, slam.in_view = set(plain["moving"]), {t: n for t, n in plain["in_view"]}
    slam.same = [(new, old) for new, old in plain["same"]]
    at = plain["odometer"]
    slam.odometer = Odometer(_pose(at["pose"]), at["way_m"], at["known_at_m"])
    slam.landmarks = {mark["number"]: _landmark(mark) for mark in plain["landmarks"]}
    slam.state = _state(plain["state"])
    smoother_from_arrays(slam.smoother, arrays, slam.model, slam.noise)
    hidden = iter(arrays["occluders"])
    for row in plain["candidates"]:
        sights = [
            slam.sights.of(s["index"], _detection(s["detection"]), _mask(next(hidden), slam)) for s in row["sights"]
        ]
        slam.candidates[row["track"]] = Candidate(sights, row["next_try"])


def _pose(matrix: Any) -> Pose:  # noqa: ANN401 # nested lists
    return Pose.from_matrix(np.array(matrix, float))


def _mask(packed: Bytes, slam: Slam) -> Bytes:
    height, width = slam.camera.height, slam.camera.width
    return np.unpackbits(packed, count=height * width).reshape(height, width)


def _landmark_to_plain(mark: Landmark) -> dict[str, Any]:
    row = {name: getattr(mark, name) for name in ("number", "track", "views", "nearest_m", "last_way_m", "moves")}
    row |= {"z": mark.z.tolist(), "dimensions": mark.dimensions.tolist()}
    in_map = None if mark.in_map is None else mark.in_map.matrix.tolist()
    return row | {"world_from_object": mark.world_from_object.matrix.tolist(), "in_map": in_map}


def _landmark(row: dict[str, Any]) -> Landmark:
    arrays = {name: np.array(row[name], float) for name in ("z", "dimensions")}
    in_map = None if row["in_map"] is None else _pose(row["in_map"])
    return Landmark(**row | arrays | {"world_from_object": _pose(row["world_from_object"]), "in_map": in_map})


def _candidate_to_plain(track: int, candidate: Candidate) -> dict[str, Any]:
    sights = [{"index": s.index, "detection": _detection_to_plain(s.detection)} for s in candidate.sights]
    return {"track": track, "next_try": candidate.next_try, "sights": sights}


def _detection_to_plain(detection: Detection) -> dict[str, Any]:
    row = {f.name: getattr(detection, f.name) for f in fields(detection)}
    return row | {name: None if row[name] is None else row[name].tolist() for name in _ARRAYS}


def _detection(row: dict[str, Any]) -> Detection:
    arrays = {name: None if row[name] is None else np.array(row[name], float) for name in _ARRAYS}
    return Detection(**row | arrays | {"bbox": tuple(row["bbox"]), "image_size": tuple(row["image_size"])})


def _state_to_plain(state: NavState) -> dict[str, Any]:
    return {
        "time_s": state.time_s,
        "pose": state.world_from_imu.matrix.tolist(),
        "velocity": state.velocity_in_world.tolist(),
        "biases": [*state.accelerometer_bias.tolist(), *state.gyroscope_bias.tolist()],
    }


def _state(row: dict[str, Any]) -> NavState:
    biases = np.array(row["biases"])
    return NavState(row["time_s"], _pose(row["pose"]), np.array(row["velocity"]), biases[:3], biases[3:])
