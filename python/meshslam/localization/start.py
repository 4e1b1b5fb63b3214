"""How a run starts without a given state: a rough alignment, then the first seconds again until they settle."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from meshslam.errors import SequenceError
from meshslam.geometry import Pose
from meshslam.geometry.arrays import Floats
from meshslam.localization.alignment import Alignment, AlignmentConfig, BoxSight, CameraMotion, align, levelled
from meshslam.localization.config import ImuConfig, LocalizationConfig
from meshslam.localization.imu import NavState, Preintegrator
from meshslam.mapping.track import is_cut
from meshslam.perception import Detection, DetectionSet
from meshslam.sequences import ImuSamples, Sequence

_EDGE_PX = 4.0
_LEAST_SIGHTS = 3  # of a track that counts
_SETTLED = 0.003  # share of the speed by which another round moves it
_LARGEST_BIAS_RAD_S = 0.02  # a steady turn is none
_STANDING_RATE_RAD_S, _STANDING_FORCE_M_S2 = 0.004, 0.15  # standard deviations below which the IMU may stand still


@dataclass(frozen=True, eq=False)
class RoughStart:
    """The first state in a levelled world: the camera at the origin, looking along x; and what the boxes say."""

    state: NavState
    frames: int  # that were looked at
    places_m: dict[int, Floats]  # of each track's object, in the levelled world


def loose(config: LocalizationConfig, speed_m_s: float) -> LocalizationConfig:
    """The settings for a start that is roughly known: velocity, roll and pitch are loose, place and heading are not."""
    start = config.start
    velocity_sigma = float(np.hypot(start.unknown_velocity_sigma_m_s, start.unknown_velocity_share * speed_m_s))
    tilt = start.unknown_tilt_sigma_deg
    return replace(config, start=replace(start, rotation_sigma_deg=tilt, velocity_sigma_m_s=velocity_sigma))


def frames_within(sequence: Sequence, seconds: float) -> int:
    """How many frames the first seconds hold."""
    return int(np.searchsorted(sequence.times_s, sequence.times_s[0] + seconds, side="right"))


def rough_start(
    sequence: Sequence,
    imu: ImuSamples,
    imu_from_camera: Pose,
    detections: Iterable[tuple[Detection, float]],
    config: ImuConfig,
    alignment: AlignmentConfig,
) -> RoughStart:
    """Gravity, velocity and scale from the first seconds; `detections` are tracked, with their categories' heights.

    SequenceError where too little is seen.
    """
    frames = frames_within(sequence, alignment.seconds)
    sights = box_sights(sequence, detections, frames)
    if not sights:
        raise SequenceError(
            f"{sequence.root}: no start: there is no initial_state.yaml, and no object is seen whole in "
            f"{_LEAST_SIGHTS} of the first {frames} frames: give initial_state.yaml (FORMATS), or begin where objects "
            "are in view"
        )
    gyroscope_bias = standing_rate(imu, sequence.times_s[:frames])
    motions = camera_motions(imu, imu_from_camera, sequence.times_s[:frames], config, gyroscope_bias)
    force = mean_force(imu, motions, imu_from_camera, sequence.times_s[:frames])
    found = align(
        motions, sights, sequence.camera, force, config.gravity_m_s2, sequence.height_above_ground_m, alignment
    )
    return RoughStart(*_in_level(found, sequence, imu_from_camera, gyroscope_bias, frames))


def _in_level(
    found: Alignment, sequence: Sequence, imu_from_camera: Pose, gyroscope_bias: Floats, frames: int
) -> tuple[NavState, int, dict[int, Floats]]:
    level = levelled(found.gravity_m_s2, imu_from_camera.rotation[:, 2])
    world_from_imu = Pose(level, -level @ imu_from_camera.translation)
    first_s = float(sequence.times_s[0])
    state = NavState(first_s, world_from_imu, level @ found.velocity_m_s, np.zeros(3), gyroscope_bias)
    return state, frames, {t: world_from_imu.transform(p) for t, p in found.places_m.items()}


def box_sights(sequence: Sequence, detections: Iterable[tuple[Detection, float]], frames: int) -> list[BoxSight]:
    """Whole boxes of tracks in the first frames; tracks of fewer than three are left out."""
    index = {frame: i for i, frame in enumerate(sequence.frame_ids[:frames])}
    found: dict[int, list[BoxSight]] = {}
    for detection, height_m in detections:
        at, number = index.get(detection.frame), detection.track_id
        if at is None or number is None or is_cut(detection, sequence.camera, _EDGE_PX):
            continue
        x, y, w, h = detection.bbox
        found.setdefault(number, []).append(BoxSight(number, at, (x + w / 2, y + h / 2), h, height_m))
    return [s for number in sorted(found) if len(found[number]) >= _LEAST_SIGHTS for s in found[number]]


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


def mean_force(imu: ImuSamples, motions: list[CameraMotion], imu_from_camera: Pose, times_s: Floats) -> Floats:
    """Mean specific force (3,) over the frames, in the first IMU's frame."""
    forces = np.array([[np.interp(t, imu.times_s, c) for c in imu.specific_force_m_s2.T] for t in times_s])
    turned = [m.rotation @ imu_from_camera.rotation.T @ f for m, f in zip(motions, forces, strict=True)]
    mean: Floats = np.mean(turned, axis=0)
    return mean


def standing_rate(imu: ImuSamples, times_s: Floats) -> Floats:
    """The gyroscope's bias (3,) if the IMU stands still over these times, else zeros."""
    inside = (imu.times_s >= times_s[0]) & (imu.times_s <= times_s[-1])
    rates, forces = imu.angular_rate_rad_s[inside], imu.specific_force_m_s2[inside]
    if len(rates) < 10 or rates.std(0).max() > _STANDING_RATE_RAD_S or forces.std(0).max() > _STANDING_FORCE_M_S2:
        return np.zeros(3)
    mean: Floats = rates.mean(0)
    return mean if float(np.linalg.norm(mean)) < _LARGEST_BIAS_RAD_S else np.zeros(3)


class Estimator(Protocol):
    """What runs frame by frame from a state, and knows afterwards what the first one was."""

    def begin(self, frame: int, state: NavState, imu: ImuSamples, detections: tuple[Detection, ...]) -> object:
        """The first frame."""

    def process(self, frame: int, time_s: float, imu: ImuSamples, detections: tuple[Detection, ...]) -> object:
        """The next frame."""

    def first_state(self) -> NavState:
        """The first frame's state as it is now seen."""


def settled(
    sequence: Sequence,
    imu: ImuSamples,
    detections: DetectionSet,
    first: NavState,
    fresh: Callable[[LocalizationConfig], Estimator],
    config: LocalizationConfig,
    lag_s: float,
    progress: Callable[[str, int, int], None] | None = None,
) -> NavState:
    """Run the first seconds from a state, take the state that they end up with, and run them again from there.

    Within `lag_s` the estimator still holds its first state.
    """
    seconds = min(config.start.settling_s, 0.9 * lag_s)
    state, rounds = first, config.start.settling_rounds
    by_frame, frames = detections.by_frame(), frames_within(sequence, seconds)
    for k in range(rounds):
        estimator = fresh(config)
        for index, frame in enumerate(sequence.frame_ids[:frames]):
            seen = by_frame.get(frame, ())
            if index == 0:
                estimator.begin(frame, state, imu, seen)
            else:
                estimator.process(frame, float(sequence.times_s[index]), imu, seen)
        # biases begin anew: their prior would count twice, and they would run away from round to round
        before, found = state, estimator.first_state()
        state = replace(found, accelerometer_bias=first.accelerometer_bias, gyroscope_bias=first.gyroscope_bias)
        if progress is not None:
            progress("start", k + 1, rounds)
        moved = float(np.linalg.norm(state.velocity_in_world - before.velocity_in_world))
        if moved < _SETTLED * max(1.0, float(np.linalg.norm(state.velocity_in_world))):
            break
    return state


def found_start(
    sequence: Sequence,
    imu: ImuSamples,
    detections: DetectionSet,
    heights_m: dict[str, float],
    fresh: Callable[[LocalizationConfig], Estimator],
    config: LocalizationConfig,
    lag_s: float,
    progress: Callable[[str, int, int], None] | None = None,
) -> tuple[NavState, LocalizationConfig]:
    """The first state in a levelled world whose origin is the first camera, and the settings to begin with it."""
    assert sequence.imu_from_camera is not None
    sized = [(d, heights_m[d.category]) for d in detections.detections if d.category in heights_m]
    rough = rough_start(sequence, imu, sequence.imu_from_camera, sized, config.imu, config.alignment)
    free = loose(config, float(np.linalg.norm(rough.state.velocity_in_world)))
    return settled(sequence, imu, detections, rough.state, fresh, free, lag_s, progress), free
