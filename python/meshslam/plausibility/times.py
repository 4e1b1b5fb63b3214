"""Whether stamps are seconds."""

from __future__ import annotations

import numpy as np

from meshslam.geometry import Floats
from meshslam.plausibility.finding import Finding

FRAME_STEP_S = (1e-3, 10.0)  # between frames
SAMPLE_STEP_S = (2e-4, 0.2)  # between IMU samples: 5 Hz to 5 kHz
_UNITS = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}


def judge_times(times_s: Floats, what: str, source: str, plausible_s: tuple[float, float]) -> list[Finding]:
    """Stamps whose median step no recording has: they are in another unit, or broken.

    `what` are frames or samples, `source` names the file.
    """
    if len(times_s) < 2:
        return []
    step_s = float(np.median(np.diff(times_s)))
    low, high = plausible_s
    if low <= step_s <= high:
        return []
    figures = {"median_step_s": step_s}
    fitting = [name for name, seconds in _UNITS.items() if low <= step_s * seconds <= high]
    if fitting:
        advice = f"they look like {fitting[0]}: write seconds"
    elif step_s <= 0:
        advice = "they do not increase"
    else:
        advice = "times are in seconds"
    message = f"{source}: {what} are {step_s:.6g} s apart in the median, expected {low:g} to {high:g} s: {advice}"
    return [Finding("times_unit", message, figures=figures)]
