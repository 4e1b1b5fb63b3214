"""A recording as a robot's drivers would send it: by its clock."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping, Sequence

from meshslam.errors import SequenceError
from meshslam.live.slam import LiveSlam, Progress
from meshslam.perception import Detection
from meshslam.sequences import Sequence as Recording

_IMU_STEP_S = 0.01  # of the clock, between deliveries of samples
_BEFORE_S = 1.0  # of samples before the first frame


def replay(
    recording: Recording,
    live: LiveSlam,
    rate: float = 1.0,
    detections: Mapping[int, Sequence[Detection]] | None = None,
    progress: Progress | None = None,
) -> None:
    """Give a recording's samples and frames to `live` when their time has come, `rate` times as fast as they were.

    `detections` are given with their frames instead of being found by the network. SequenceError without an IMU, and
    what `live` raises.
    """
    if recording.imu is None:
        raise SequenceError(f"{recording.root}: live SLAM needs an IMU: imu.csv, oxts, or --imu FILE")
    times_s, imu = recording.times_s.tolist(), recording.imu
    given_s = times_s[0] - _BEFORE_S
    began_s: float | None = None
    pause = threading.Event()  # never set: its wait lets Ctrl-C through at once
    for index, number in enumerate(recording.frame_ids):
        image = None if recording.images is None else recording.read_image(index)
        if began_s is None:
            began_s = time.perf_counter()
        while True:
            now_s = times_s[0] + rate * (time.perf_counter() - began_s)
            if now_s > given_s:
                samples = imu.between(given_s, now_s)
                if len(samples.times_s):
                    live.add_imu(samples)
                given_s = now_s
            if now_s >= times_s[index]:
                break
            pause.wait(min(_IMU_STEP_S, (times_s[index] - now_s) / rate))
        given = None if detections is None else detections.get(number, ())
        live.add_frame(image, times_s[index], number, detections=given)
        if progress is not None:
            progress("live", index + 1, len(times_s))
    live.add_imu(imu.between(given_s, times_s[-1] + _BEFORE_S))
