"""Messages in: images without distortion, IMU samples, the camera; what cannot be used is counted, with the reason."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.errors import SequenceError
from meshslam.geometry import Bytes
from meshslam.sequences import (
    CameraFile,
    ImuSamples,
    Report,
    bits_of,
    camera_of_info,
    frame_of,
    image_of,
    is_rectified_topic,
    stamp_ns,
)

JUMP_BACK_NS = 2_000_000_000  # of stamps, beyond which a clock was set back and messages are not just late


@dataclass
class InputState:
    """What has come on one topic."""

    name: str  # images, IMU, camera info
    topic: str
    received: int = 0
    refused: int = 0
    late: int = 0  # of the refused: their stamp is not after the newest one's
    lost: int = 0  # by the middleware, of those that were sent
    why: str = ""  # the newest one was refused; empty after one that was taken
    newest_ns: int | None = None  # stamp of the newest message that was taken
    arrived_s: float | None = None  # when the last message came, by a steady clock
    problem: str = ""  # found by the middleware: incompatible QoS
    frame: str = ""  # that headers name

    def came(self, now_s: float) -> None:
        """Count a message."""
        self.received += 1
        self.arrived_s = now_s
        self.problem = ""

    def refuse(self, why: str) -> None:
        """Count it as one that cannot be used."""
        self.refused += 1
        self.why = why

    def in_order(self, stamp: int) -> bool:
        """Whether a stamp is a time and after the newest one; a message that is not is refused."""
        if stamp <= 0:
            self.refuse("its header has no stamp: the driver must set it")
            return False
        if self.newest_ns is not None and stamp <= self.newest_ns:
            self.late += 1
            behind_s = (self.newest_ns - stamp) / 1e9
            is_jump = self.newest_ns - stamp > JUMP_BACK_NS
            what = "the clock was set back, or a recording began anew: call ~/reset" if is_jump else "it came too late"
            self.refuse(f"its stamp is {behind_s:.3f} s before the newest one's: {what}")
            return False
        return True

    def take(self, stamp: int, frame: str) -> None:
        """Note a message that is used."""
        self.newest_ns, self.frame, self.why = stamp, frame, ""

    def begin_anew(self) -> None:
        """Forget the newest stamp: the clock may have been set back."""
        self.newest_ns, self.why = None, ""


class Images:
    """Decodes images of one topic, and removes the camera's distortion."""

    def __init__(self, state: InputState) -> None:
        """`state` counts them."""
        self.state = state
        self._bits: int | None = None  # of the first image that has 16 a channel
        self._is_first = True

    def read(self, message: Any, camera: CameraFile | None, now_s: float) -> tuple[Bytes, int] | None:  # noqa: ANN401 # ROS'
        """The undistorted image, BGR (h, w, 3), and its stamp in ns; None for one that cannot be used."""
        self.state.came(now_s)
        stamp = stamp_ns(message)
        if not self.state.in_order(stamp):
            return None
        if camera is None:
            self.state.why = ""
            return None
        raw = camera.camera if camera.distortion is None else camera.distortion.raw_camera
        where = Path(self.state.topic)
        try:
            if self._is_first:
                self._bits, self._is_first = bits_of(where, "", message), False
            image = image_of(where, "", message, (raw.width, raw.height), self._bits)
        except SequenceError as error:
            self.state.refuse(str(error))
            return None
        self.state.take(stamp, frame_of(message))
        return (image if camera.distortion is None else camera.distortion.undistort_image(image)), stamp


def imu_sample(message: Any, state: InputState, ahead_s: float, now_s: float) -> ImuSamples | None:  # noqa: ANN401 # ROS'
    """One sample on the camera's clock, which the IMU's is `ahead_s` ahead of; None for one that cannot be used.

    Samples that came late are passed on: the estimation sorts them.
    """
    state.came(now_s)
    stamp = stamp_ns(message)
    if stamp <= 0:
        state.refuse("its header has no stamp: the driver must set it")
        return None
    for part, name in (("angular_velocity", "angular rate"), ("linear_acceleration", "specific force")):
        if float(getattr(message, f"{part}_covariance")[0]) == -1.0:  # as sensor_msgs/Imu has it
            state.refuse(f"it says that the IMU has no {name} ({part}_covariance[0] is -1)")
            return None
    rows = [[getattr(message, part), *"xyz"] for part in ("angular_velocity", "linear_acceleration")]
    values = np.array([[float(getattr(vector, axis)) for axis in axes] for vector, *axes in rows])
    if not np.isfinite(values).all():
        state.refuse("it holds NaN or infinity")
        return None
    state.take(max(stamp, state.newest_ns or 0), frame_of(message))
    return ImuSamples(np.array([stamp / 1e9 - ahead_s]), values[:1], values[1:])


def camera_of_message(message: Any, image_topic: str, state: InputState, now_s: float) -> CameraFile | None:  # noqa: ANN401 # ROS'
    """The camera of a CameraInfo; None, with the reason in `state`, where it is none that can be used."""
    state.came(now_s)
    try:
        report = Report()
        found = camera_of_info(Path(state.topic), "", message, is_rectified_topic(image_topic), report)
    except SequenceError as error:
        state.refuse(str(error))
        return None
    state.take(max(stamp_ns(message), 1), frame_of(message))
    return found


def camera_values(message: Any) -> tuple[Any, ...]:  # noqa: ANN401 # ROS'
    """What makes a calibration another one."""
    lists = tuple(tuple(float(v) for v in getattr(message, name)) for name in "kdp")
    return (int(message.width), int(message.height), str(message.distortion_model), *lists)
