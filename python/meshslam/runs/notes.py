"""What a run can handle but its user should know: gaps of the IMU, a scale hardly known, stretches without objects."""

from __future__ import annotations

import numpy as np

from meshslam.motion import ImuConfig, sample_rate_hz
from meshslam.perception import DetectionSet
from meshslam.sequences import Sequence

_LONG_S = 1.0  # without objects


def imu_notes(sequence: Sequence, config: ImuConfig) -> list[str]:
    """Where samples are missing between the first and the last frame."""
    imu, root = sequence.imu, sequence.root
    if imu is None or len(imu.times_s) < 2:
        return []
    longest_s = config.gap_periods / max(sample_rate_hz(imu), 1e-9)
    first_s, last_s = float(sequence.times_s[0]), float(sequence.times_s[-1])
    inside = imu.times_s[(imu.times_s > first_s) & (imu.times_s < last_s)]
    at = np.concatenate([[first_s], inside, [last_s]])
    found = []
    for begin_s, end_s in zip(at[:-1].tolist(), at[1:].tolist(), strict=True):
        if end_s - begin_s > longest_s:
            frames = int(((sequence.times_s > begin_s) & (sequence.times_s <= end_s)).sum())
            found.append(
                f"{root}: no IMU samples from {begin_s:.2f} s to {end_s:.2f} s ({frames} frames): there "
                "the path follows from detections and images alone, and is poor where these are few"
            )
    return found


def scale_notes(sequence: Sequence) -> list[str]:
    """That nothing but the sizes of cars tells SLAM how long a metre is."""
    if sequence.imu is not None or sequence.height_above_ground_m is not None:
        return []
    return [
        f"{sequence.root}: there is no IMU, and the camera's height above the ground is not known: the scale follows "
        "from the sizes of cars alone, and parked cars may be taken for moving ones: give the height, as "
        "height_above_ground_m in a camera.yaml"
    ]


def object_notes(sequence: Sequence, detections: DetectionSet) -> list[str]:
    """Long stretches of frames in which nothing is detected."""
    by_frame = detections.by_frame()
    empty = [not by_frame.get(frame) for frame in sequence.frame_ids]
    if all(empty):
        return [f"{sequence.root}: no object is detected in any frame: the path is that of odometry alone"]
    found, start = [], None
    for i, nothing in enumerate([*empty, False]):
        if nothing and start is None:
            start = i
        if not nothing and start is not None:
            end = min(i, len(empty) - 1)
            missing_s = float(sequence.times_s[end] - sequence.times_s[start])
            if missing_s >= _LONG_S:
                frames = f"{sequence.frame_ids[start]} to {sequence.frame_ids[i - 1]}"
                found.append(
                    f"{sequence.root}: no object is detected in frames {frames} ({missing_s:.1f} s): the path there is "
                    "that of odometry alone"
                )
            start = None
    return found
