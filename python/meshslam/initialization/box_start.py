"""A rough first state from the boxes of tracked objects, with the IMU or with the images alone."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from meshslam.errors import SequenceError
from meshslam.features import ImageFeatures, two_views
from meshslam.geometry import Floats, Pose
from meshslam.initialization.first_frames import FirstFrames
from meshslam.initialization.gravity_alignment import (
    Alignment,
    AlignmentConfig,
    BoxObservation,
    CameraMotion,
    align,
    levelled,
)
from meshslam.motion import ImuConfig, NavState, Preintegrator, mean_specific_force
from meshslam.objects import is_cut
from meshslam.perception import Detection
from meshslam.sequences import ImuSamples

_EDGE_PX = 4.0
_MIN_OBSERVATIONS = 3  # of a track that counts
_LARGEST_BIAS_RAD_S = 0.02  # a steady turn is none
_STANDING_RATE_RAD_S, _STANDING_FORCE_M_S2 = 0.004, 0.15  # standard deviations below which the IMU may stand still


@dataclass(frozen=True, eq=False)
class RoughStart:
    """The first state in a levelled world: the camera at the origin, looking along x; and what the boxes say."""

    state: NavState
    frames: int  # that were looked at
    places_m: dict[int, Floats]  # of each track's object, in the levelled world


def rough_start(
    first: FirstFrames,
    imu: ImuSamples,
    imu_from_camera: Pose,
    detections: Iterable[tuple[Detection, float]],
    config: ImuConfig,
    alignment: AlignmentConfig,
) -> RoughStart:
    """Gravity, velocity and scale from the first seconds; `detections` are tracked, with their categories' heights.

    SequenceError where too little is seen.
    """
    frames = first.count_within(alignment.seconds)
    observations = first_box_observations(first, detections, frames)
    gyroscope_bias = standing_rate(imu, first.times_s[:frames])
    motions = camera_motions(imu, imu_from_camera, first.times_s[:frames], config, gyroscope_bias)
    turns = [m.rotation @ imu_from_camera.rotation.T for m in motions]
    force = mean_specific_force(imu, first.times_s[:frames], turns)
    found = align(
        motions, observations, first.camera, force, config.gravity_m_s2, first.height_above_ground_m, alignment
    )
    return RoughStart(*_in_level(found, first, imu_from_camera, gyroscope_bias, frames))


def rough_start_by_images(
    first: FirstFrames,
    image_features: ImageFeatures,
    detections: Iterable[tuple[Detection, float]],
    gravity_m_s2: float,
    alignment: AlignmentConfig,
) -> RoughStart:
    """The same without an IMU: the path's shape from point tracks, its length from boxes and the camera's height."""
    frames = first.count_within(alignment.seconds)
    observations = first_box_observations(first, detections, frames)
    motions = motions_by_images(image_features, first, frames)
    ahead = motions[1].displacement_s
    assert ahead is not None
    along = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    up = np.array([0.0, -1.0, 0.0]) + along[1] * along  # the road lies along the path
    height = first.height_above_ground_m
    found = align(motions, observations, first.camera, gravity_m_s2 * up, gravity_m_s2, height, alignment)
    found = replace(found, velocity_m_s=found.velocity_m_s[0] * along)
    return RoughStart(*_in_level(found, first, Pose.identity(), np.zeros(3), frames))


def motions_by_images(image_features: ImageFeatures, first: FirstFrames, frames: int) -> list[CameraMotion]:
    """Cameras by the steps between images, all as long as an even speed of 1 makes them; in the first camera."""
    pose, times = Pose.identity(), first.times_s
    motions = [CameraMotion(0.0, pose.rotation, np.zeros(3), None, np.zeros(3))]
    for index in range(1, frames):
        step = two_views(image_features.matches(index), first.camera)
        pose = pose @ Pose(step.rotation, step.translation * float(times[index] - times[index - 1]))
        motions.append(CameraMotion(float(times[index] - times[0]), pose.rotation, np.zeros(3), None, pose.translation))
    return motions


def first_box_observations(
    first: FirstFrames, detections: Iterable[tuple[Detection, float]], frames: int
) -> list[BoxObservation]:
    """Boxes of the first frames; SequenceError if there are none."""
    observations = box_observations(first, detections, frames)
    if not observations:
        raise SequenceError(
            f"{first.source}: no start: there is no initial_state.yaml, and no object is seen whole in "
            f"{_MIN_OBSERVATIONS} of the first {frames} frames: give initial_state.yaml (docs/formats.md), or begin "
            "where objects are in view"
        )
    return observations


def _in_level(
    found: Alignment, first: FirstFrames, imu_from_camera: Pose, gyroscope_bias: Floats, frames: int
) -> tuple[NavState, int, dict[int, Floats]]:
    level = levelled(found.gravity_m_s2, imu_from_camera.rotation[:, 2])
    world_from_imu = Pose(level, -level @ imu_from_camera.translation)
    first_s = float(first.times_s[0])
    state = NavState(first_s, world_from_imu, level @ found.velocity_m_s, np.zeros(3), gyroscope_bias)
    return state, frames, {t: world_from_imu.transform(p) for t, p in found.places_m.items()}


def box_observations(
    first: FirstFrames, detections: Iterable[tuple[Detection, float]], frames: int
) -> list[BoxObservation]:
    """Whole boxes of tracks in the first frames; tracks of fewer than three are left out."""
    index = {frame: i for i, frame in enumerate(first.frame_ids[:frames])}
    found: dict[int, list[BoxObservation]] = {}
    for detection, height_m in detections:
        at, number = index.get(detection.frame), detection.track_id
        if at is None or number is None or is_cut(detection, first.camera, _EDGE_PX):
            continue
        x, y, w, h = detection.bbox
        found.setdefault(number, []).append(BoxObservation(number, at, (x + w / 2, y + h / 2), h, height_m))
    return [s for number in sorted(found) if len(found[number]) >= _MIN_OBSERVATIONS for s in found[number]]


def camera_motions(
    imu: ImuSamples, imu_from_camera: Pose, times_s: Floats, config: ImuConfig, gyroscope_bias: Floats
) -> list[CameraMotion]:
    """Cameras at these times by the IMU without gravity and start, in the first IMU's frame."""
    preintegrator, first_s = Preintegrator(config), float(times_s[0])
    origin = NavState(first_s, Pose.identity(), np.zeros(3), np.zeros(3), gyroscope_bias)
    arm = imu_from_camera.translation
    motions = [CameraMotion(0.0, imu_from_camera.rotation, arm, np.zeros(3))]
    for time_s in times_s[1:].tolist():
        measured = preintegrator.between(imu, first_s, time_s, origin).measurements
        turned, moved = measured.deltaRij().matrix(), np.asarray(measured.deltaPij(), float)
        rotation, gain = turned @ imu_from_camera.rotation, np.asarray(measured.deltaVij(), float)
        motions.append(CameraMotion(time_s - first_s, rotation, moved + turned @ arm, gain))
    return motions


def standing_rate(imu: ImuSamples, times_s: Floats) -> Floats:
    """The gyroscope's bias (3,) if the IMU stands still over these times, else zeros."""
    inside = (imu.times_s >= times_s[0]) & (imu.times_s <= times_s[-1])
    rates, forces = imu.angular_rate_rad_s[inside], imu.specific_force_m_s2[inside]
    if len(rates) < 10 or rates.std(0).max() > _STANDING_RATE_RAD_S or forces.std(0).max() > _STANDING_FORCE_M_S2:
        return np.zeros(3)
    mean: Floats = rates.mean(0)
    return mean if float(np.linalg.norm(mean)) < _LARGEST_BIAS_RAD_S else np.zeros(3)
