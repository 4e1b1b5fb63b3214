"""The path at the frames that the window skipped: by the IMU, between the frames that it took in."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.maps import Trajectory, TrajectoryEstimate
from meshslam.motion import ImuConfig, Mounting, NavState, Preintegrator, predict, rate_at
from meshslam.sequences import ImuSamples


class _Gap:
    """The path after a frame of an estimate, and up to the next one."""

    def __init__(
        self, estimate: TrajectoryEstimate, index: int, imu: ImuSamples, mounting: Mounting, config: ImuConfig
    ) -> None:
        path, self._mounting, self._imu = estimate.trajectory, mounting, imu
        self._preintegrator = Preintegrator(config)
        pose, time_s = path.world_from_camera[index], float(path.times_s[index])
        biases = np.zeros(6) if estimate.biases is None else estimate.biases[index]
        rate = rate_at(imu, time_s) - biases[3:] if len(imu.times_s) else np.zeros(3)
        world_from_imu = pose @ mounting.imu_from_camera.inverse()
        swing = world_from_imu.rotation @ np.cross(rate, mounting.imu_from_camera.translation)
        self._state = NavState(
            time_s, world_from_imu, estimate.velocity_in_world[index] - swing, biases[:3], biases[3:]
        )
        self._missed, self._length_s = np.zeros(6), 1.0
        if index + 1 < len(path):
            self._length_s = float(path.times_s[index + 1]) - time_s
            self._missed = self._predicted(self._length_s)[0].local(path.world_from_camera[index + 1])

    def at(self, since_s: float) -> tuple[Pose, Floats]:
        """Camera and velocity so long after its beginning; what the IMU misses at the end is spread over the gap."""
        pose, velocity = self._predicted(since_s)
        return pose.retract(since_s / self._length_s * self._missed), velocity

    def _predicted(self, since_s: float) -> tuple[Pose, Floats]:
        if not len(self._imu.times_s):  # no sample at all: straight on
            moved = Pose(np.eye(3), since_s * self._state.velocity_in_world) @ self._state.world_from_imu
            return moved @ self._mounting.imu_from_camera, self._state.velocity_in_world
        end_s = self._state.time_s + since_s
        interval = self._preintegrator.between(self._imu, self._state.time_s, end_s, self._state)
        after = predict(self._state, interval, end_s)
        rate = interval.angular_rate_rad_s - self._state.gyroscope_bias
        pose = self._mounting.world_from_camera(after, rate)
        return pose, after.velocity_in_world + after.world_from_imu.rotation @ np.cross(
            rate, self._mounting.imu_from_camera.translation
        )


def filled(
    estimate: TrajectoryEstimate,
    frames: Sequence[tuple[int, float]],
    imu_between: Callable[[float, float], ImuSamples],
    imu_from_camera: Pose,
    config: ImuConfig,
) -> TrajectoryEstimate:
    """An estimate with rows for all `frames`, number and time in s; the world is z up.

    Frames that it has stay as they are. The others follow from the frame before by the IMU's samples, and end at the
    next frame's pose; their covariance is that of the frame before. Frames before the first are left out.
    """
    row_of = {number: row for row, number in enumerate(estimate.frame_ids)}
    ends_s = [*estimate.trajectory.times_s[1:].tolist(), frames[-1][1]]
    placed: list[tuple[Pose, Floats, int, int, float]] = []  # pose, velocity, row, number, time
    row, gap = -1, None
    for number, time_s in frames:
        if number in row_of:
            row, gap = row_of[number], None
            pose, velocity = estimate.trajectory.world_from_camera[row], estimate.velocity_in_world[row]
        elif row < 0:
            continue
        else:
            if gap is None:
                begin_s = float(estimate.trajectory.times_s[row])
                imu = imu_between(begin_s - 0.1, max(ends_s[row], time_s) + 0.1)
                gap = _Gap(estimate, row, imu, Mounting(imu_from_camera), config)
            pose, velocity = gap.at(time_s - float(estimate.trajectory.times_s[row]))
        placed.append((pose, velocity, row, number, time_s))
    poses, velocities, rows, numbers, times_s = (list(column) for column in zip(*placed, strict=True))
    is_new = np.array([number not in row_of for number in numbers])
    return replace(
        estimate,
        trajectory=Trajectory(np.array(times_s), tuple(poses)),
        frame_ids=tuple(numbers),
        covariances=estimate.covariances[rows],
        velocity_in_world=np.array(velocities),
        biases=None if estimate.biases is None else estimate.biases[rows],
        sources=tuple("imu" if new else estimate.sources[row] for new, row in zip(is_new, rows, strict=True)),
        extrapolated=estimate.extrapolated[rows] | is_new,
    )
