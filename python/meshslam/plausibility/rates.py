"""Whether an IMU's rates turn the camera as much as what it sees, or as its known poses, do.

The rates of a vehicle on level ground turn about the vertical alone. Gravity says nothing about those: what stands
around the camera does.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from meshslam.geometry import Camera, Floats, Pose, exp_so3, log_so3
from meshslam.perception import Detection
from meshslam.plausibility.finding import Finding
from meshslam.sequences import ImuSamples

_MIN_PAIRS, _MIN_POINTS, _ENOUGH_PAIRS = 5, 10, 40
_LONGEST_STEP_S = 0.5
_MIN_SHIFT_PX = 6.0  # between two frames, by the rates as they are
_WORSE = 2.5  # as radians than as degrees
_SLACK_PX = 2.0
_TURN_S = 0.5
_MIN_TURN_RAD, _MIN_AXIS_RAD = 0.005, 0.03  # over half a second, to tell its size and its axis
_DEGREES_RANGE = (20.0, 120.0)  # around 180 / pi
_AGREE = 0.5  # cosine between the turns: 1 where they are the same
_ADVICE = "they are degrees a second: multiply wx, wy, wz by pi / 180"


def centres(detections: Sequence[Detection]) -> Floats:
    """The middles (n, 2) of the boxes, px."""
    boxes = np.array([d.bbox for d in detections], float).reshape(-1, 4)
    middles: Floats = boxes[:, :2] + 0.5 * boxes[:, 2:]
    return middles


class RatesBySight:
    """Rates in degrees: taken as radians they move what is seen far more than it moves.

    Give it the pixels (n, 2) of what is seen, frame by frame: the points of two frames need not be the same ones, the
    nearest counts. Frames between which the rates move little tell nothing.
    """

    def __init__(self, camera: Camera, imu_from_camera: Pose) -> None:
        self._camera, self._camera_from_imu = camera, imu_from_camera.rotation.T
        self._last: tuple[float, Floats] | None = None
        self._shifts: list[Floats] = []
        self._as_radians: list[Floats] = []
        self._as_degrees: list[Floats] = []

    @property
    def is_enough(self) -> bool:
        """Whether more frames would change nothing."""
        return len(self._shifts) >= _ENOUGH_PAIRS

    def add(self, time_s: float, pixels: Floats, imu: ImuSamples) -> None:
        """The next frame; the samples are at least those since the last one."""
        last, self._last = self._last, (time_s, pixels)
        if last is None or self.is_enough or not len(last[1]) or not len(pixels):
            return
        turn = turned(imu, last[0], time_s) if time_s - last[0] <= _LONGEST_STEP_S else None
        if turn is None:
            return
        by_radians = _moved(self._camera, last[1], self._camera_from_imu @ turn)
        by_degrees = _moved(self._camera, last[1], self._camera_from_imu @ (turn * np.pi / 180))
        both = np.isfinite(by_radians).all(1) & np.isfinite(by_degrees).all(1)
        shifts = np.linalg.norm((by_radians - last[1])[both], axis=1)
        if both.any() and np.median(shifts) > _MIN_SHIFT_PX:
            self._shifts.append(shifts)
            self._as_radians.append(_to_the_nearest(by_radians[both], pixels))
            self._as_degrees.append(_to_the_nearest(by_degrees[both], pixels))

    def findings(self, source: str) -> list[Finding]:
        """An error if degrees explain what was seen so far, and radians do not."""
        if len(self._shifts) < _MIN_PAIRS or sum(map(len, self._shifts)) < _MIN_POINTS:
            return []
        lists = (self._shifts, self._as_radians, self._as_degrees)
        shift_px, radians_px, degrees_px = (float(np.median(np.concatenate(a))) for a in lists)
        if radians_px < _WORSE * degrees_px + _SLACK_PX:
            return []
        message = (
            f"{source}: by the rates what is seen moves {shift_px:.0f} px from frame to frame, which misses it by "
            f"{radians_px:.0f} px, and by {degrees_px:.1f} px if {_ADVICE}"
        )
        figures = {"shift_px": shift_px, "as_radians_px": radians_px, "as_degrees_px": degrees_px}
        return [Finding("imu_in_degrees", message, figures=figures)]


def judge_rates_by_sight(
    camera: Camera, imu: ImuSamples, imu_from_camera: Pose, seen: Iterable[tuple[float, Floats]], source: str
) -> list[Finding]:
    """`RatesBySight` over the frames of a recording: (time in s, pixels (n, 2)), in their order."""
    sight = RatesBySight(camera, imu_from_camera)
    for time_s, pixels in seen:
        if sight.is_enough:
            break
        sight.add(time_s, pixels, imu)
    return sight.findings(source)


def judge_rates_by_poses(
    imu: ImuSamples, imu_from_camera: Pose, times_s: Floats, world_from_camera: Sequence[Pose], source: str
) -> list[Finding]:
    """Rates in degrees, about other axes or with another sign, by poses at times (n,) over half a second each."""
    by_rates, by_poses = [], []
    first = 0
    for last in range(1, len(times_s)):
        step_s = float(times_s[last] - times_s[first])
        if step_s < _TURN_S:
            continue
        begin_s, end_s = float(times_s[first]), float(times_s[last])
        turn = turned(imu, begin_s, end_s) if step_s < 2 * _TURN_S else None
        if turn is not None:
            between = world_from_camera[first].rotation.T @ world_from_camera[last].rotation
            by_rates.append(turn)
            by_poses.append(imu_from_camera.rotation @ log_so3(between))
        first = last
    if len(by_rates) < _MIN_PAIRS:
        return []
    rates, poses = np.array(by_rates), np.array(by_poses)
    size_rates, size_poses = (float(np.sqrt((a**2).sum(1).mean())) for a in (rates, poses))
    if size_poses < _MIN_TURN_RAD:
        return []
    ratio, agreement = size_rates / size_poses, float((rates * poses).sum() / len(rates) / size_rates / size_poses)
    figures = {"ratio": ratio, "agreement": agreement}
    if _DEGREES_RANGE[0] < ratio < _DEGREES_RANGE[1]:
        message = f"{source}: the rates turn {ratio:.0f} times as much as the known poses: {_ADVICE}"
        return [Finding("imu_in_degrees", message, figures=figures)]
    if size_poses < _MIN_AXIS_RAD or agreement > _AGREE:
        return []
    message = (
        f"{source}: the rates turn otherwise than the known poses (agreement {agreement:.2f}, {ratio:.2f} times as "
        "much): check imu_from_camera, the signs of wx, wy, wz, and whether both have one clock"
    )
    return [Finding("imu_turns", message, "note", figures)]


def turned(imu: ImuSamples, begin_s: float, end_s: float) -> Floats | None:
    """The mean rate between two times, times the time between: a rotation vector (3,), rad, of the IMU.

    Exact where the axis stays; None where samples are missing.
    """
    low, high = np.searchsorted(imu.times_s, [begin_s, end_s])
    inside = imu.times_s[low:high]
    step_s = end_s - begin_s
    if len(inside) < 2 or np.diff(inside, prepend=begin_s, append=end_s).max() > 0.5 * step_s:
        return None
    turn: Floats = imu.angular_rate_rad_s[low:high].mean(0) * step_s
    return turn


def _moved(camera: Camera, pixels: Floats, turn_in_camera: Floats) -> Floats:
    """Where far points (n, 2) are after the camera has turned; NaN behind it and outside of the image."""
    rays = np.array([camera.rays(pixel) for pixel in pixels]) @ exp_so3(turn_in_camera)
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = (f * rays[:, k] / rays[:, 2] + c for k, f, c in ((0, camera.fx, camera.cx), (1, camera.fy, camera.cy)))
    inside = (rays[:, 2] > 0) & (x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height)
    return np.where(inside[:, None], np.stack([x, y], 1), np.nan)


def _to_the_nearest(points: Floats, others: Floats) -> Floats:
    return np.asarray(np.linalg.norm(points[:, None] - others[None], axis=2).min(1))
