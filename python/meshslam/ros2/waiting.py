"""What the node waits for, said again and again while it waits."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from meshslam.ros2.inputs import InputState

_TYPES = {
    "images": ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"),
    "IMU": ("sensor_msgs/msg/Imu",),
    "camera info": ("sensor_msgs/msg/CameraInfo",),
}
_AGAIN_S = 5.0


class Waiting:
    """Looks at what came, and says what did not.

    A calibration need come once only.
    """

    def __init__(
        self,
        patience_s: float,
        publishers: Callable[[str], list[tuple[str, str]]],
        log: Any,  # noqa: ANN401 # rclpy's logger
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """`publishers` gives the type and the node of each publisher of a topic."""
        self._patience_s, self._publishers, self._log, self._clock_s = patience_s, publishers, log, clock_s
        self._begun_s = clock_s()
        self._said: dict[str, tuple[str, float]] = {}  # by what it is about
        self._refused: dict[str, int] = {}

    def problem(self, state: InputState, now_s: float) -> str:
        """Why a topic brings nothing, or nothing that can be used; empty if it does."""
        since_s = now_s - (self._begun_s if state.arrived_s is None else state.arrived_s)
        is_one_enough = state.name == "camera info"
        if state.problem and since_s > min(1.0, self._patience_s):
            return f"{state.topic}: {state.problem}"
        if since_s > self._patience_s and not (is_one_enough and state.newest_ns is not None):
            return self._missing(state, since_s)
        if state.why and state.received and state.refused:
            return f"{state.topic}: a message cannot be used: {state.why}"
        return ""

    def _missing(self, state: InputState, since_s: float) -> str:
        there = self._publishers(state.topic)
        fitting = [node for kind, node in there if kind in _TYPES[state.name]]
        wrong = [f"{kind} by {node}" for kind, node in there if kind not in _TYPES[state.name]]
        if fitting:
            why = f"{', '.join(fitting)} publishes, and no message arrives"
        elif wrong:
            why = f"it is {', '.join(wrong)}, expected {' or '.join(_TYPES[state.name])}"
        else:
            why = "nobody publishes it"
        return f"no {state.name} on {state.topic} for {since_s:.0f} s: {why}"

    def look(self, states: Sequence[InputState], *others: str) -> None:
        """Say what is wrong, at once and every 5 s; and when it is right again."""
        now_s = self._clock_s()
        found = {state.name: self.problem(state, now_s) for state in states}
        found |= {f"other {k}": text for k, text in enumerate(others)}
        for about, text in found.items():
            self._say(about, text, now_s)

    def _say(self, about: str, text: str, now_s: float) -> None:
        before, said_s = self._said.get(about, ("", -_AGAIN_S))
        if not text:
            if before and not about.startswith("other"):
                self._log.info(f"{about} arrive again" if about == "images" else f"{about} arrives again")
            self._said.pop(about, None)
            return
        if now_s - said_s >= _AGAIN_S:
            self._log.warning(text)
            self._said[about] = (text, now_s)
