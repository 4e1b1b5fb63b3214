"""Whether an IMU's samples are what they say: rad/s and m/s², gravity in them, alive.

The specific force of a vehicle has a length near g in the median. Rates turn gravity in the sensor's frame: rates in
other units turn it by more than the accelerometer shows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Bools
from meshslam.plausibility.finding import Finding
from meshslam.plausibility.times import SAMPLE_STEP_S, judge_times
from meshslam.sequences import ImuSamples

GRAVITY_M_S2 = 9.81
WILD_FORCE_M_S2 = 10 * GRAVITY_M_S2  # no vehicle makes more
WILD_RATE_RAD_S = 35.0  # 2,000 degrees a second, the range of common gyroscopes
FROZEN_SAMPLES = 4  # so many equal ones in a row: the sensor or its driver hangs
_FORCE_RANGE_M_S2 = (8.3, 11.8)  # of the median length
_G_RANGE = (0.8, 1.25)
_NO_GRAVITY_M_S2 = 4.0
_WINDOW_S = 0.5
_TURNS_TOO_MUCH = 4.0


@dataclass(frozen=True, eq=False)
class CleanImu:
    """Samples without the broken ones, and what was found."""

    samples: ImuSamples
    findings: tuple[Finding, ...]


def clean_imu(imu: ImuSamples, source: str) -> CleanImu:
    """Leave wild and frozen samples out, as if they had not been recorded; errors where the rest cannot be right."""
    wild, frozen = wild_samples(imu), frozen_samples(imu)
    findings = _count(imu, wild, source, "wild_samples", _WILD)
    findings += _count(imu, frozen, source, "frozen_samples", _FROZEN)
    keep = ~(wild | frozen)
    if len(imu.times_s) and keep.sum() < 0.5 * len(keep):
        share = 100 * (1 - float(keep.mean()))
        message = f"{source}: {share:.0f}% of the samples are wild or frozen: the IMU was not recorded"
        return CleanImu(imu, (*findings, Finding("imu_dead", message, figures={"broken_percent": share})))
    kept = ImuSamples(imu.times_s[keep], imu.angular_rate_rad_s[keep], imu.specific_force_m_s2[keep])
    kept = imu if keep.all() else kept
    return CleanImu(kept, (*findings, *judge_imu(kept, source)))


_WILD = f"beyond {WILD_FORCE_M_S2:.0f} m/s² or {WILD_RATE_RAD_S:.0f} rad/s"
_FROZEN = f"the same six numbers {FROZEN_SAMPLES} times in a row or more"


def wild_samples(imu: ImuSamples) -> Bools:
    """Which samples (n,) no vehicle makes."""
    force, rate = (np.linalg.norm(a, axis=1) for a in (imu.specific_force_m_s2, imu.angular_rate_rad_s))
    return np.asarray(~(force <= WILD_FORCE_M_S2) | ~(rate <= WILD_RATE_RAD_S), bool)


def frozen_samples(imu: ImuSamples) -> Bools:
    """Which samples (n,) repeat the one before, in runs of `FROZEN_SAMPLES` or more; zeros count as well."""
    columns = np.hstack([imu.angular_rate_rad_s, imu.specific_force_m_s2])
    same = np.concatenate([[False], (np.diff(columns, axis=0) == 0).all(1)]) if len(columns) else np.zeros(0, bool)
    frozen = np.zeros(len(same), bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(int)))
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        zero = not columns[begin].any()
        if end - begin + 1 >= FROZEN_SAMPLES:
            frozen[begin - (1 if zero else 0) : end] = True
    return frozen


def judge_imu(imu: ImuSamples, source: str) -> list[Finding]:
    """Units, gravity, columns and stamps of samples that are alive."""
    found = judge_times(imu.times_s, "samples", source, SAMPLE_STEP_S)
    if len(imu.times_s) < 10:
        return found
    force = float(np.median(np.linalg.norm(imu.specific_force_m_s2, axis=1)))
    rate = float(np.median(np.linalg.norm(imu.angular_rate_rad_s, axis=1)))
    said = _force_problem(force, rate)
    if said:
        figures = {"median_force_m_s2": force, "median_rate_rad_s": rate}
        return [*found, Finding(said[0], f"{source}: {said[1]}", figures=figures)]
    return found if found else _rate_problem(imu, source)


def _force_problem(force: float, rate: float) -> tuple[str, str] | None:
    expected = f"the specific force is {force:.2f} m/s² long in the median, expected about 9.8"
    low, high = _FORCE_RANGE_M_S2
    if low <= force <= high:
        return None
    if low <= rate <= high:
        said = f"the angular rate is {rate:.2f} rad/s long in the median, the specific force {force:.2f} m/s²"
        return "imu_columns", f"{said}: the columns of gyroscope and accelerometer are swapped (wx, wy, wz come first)"
    if _G_RANGE[0] <= force <= _G_RANGE[1]:
        return "imu_in_g", f"{expected}: it is in g: multiply ax, ay, az by 9.80665"
    if force < _NO_GRAVITY_M_S2:
        return (
            "imu_without_gravity",
            f"{expected}: gravity was taken off: record the raw accelerometer, gravity included",
        )
    return "imu_force", f"{expected}: another unit, or a broken sensor"


def _rate_problem(imu: ImuSamples, source: str) -> list[Finding]:
    """Rates in degrees a second: taken as radians they turn gravity far more than the accelerometer shows."""
    ratio = turning_ratio(imu)
    if ratio is None or ratio < _TURNS_TOO_MUCH or ratio * np.pi / 180 > 1.5:
        return []
    message = (
        f"{source}: by the rates gravity turns {ratio:.0f} times as much as the accelerometer shows: they are degrees "
        "a second: multiply wx, wy, wz by pi / 180"
    )
    return [Finding("imu_in_degrees", message, figures={"turning_ratio": ratio})]


def turning_ratio(imu: ImuSamples) -> float | None:
    """How much the rates turn gravity over half a second, over how much the specific force changes.

    Accelerations change the specific force as well, so that true rates give about 1 or less. None for recordings of
    less than 2 s.
    """
    period_s = float(np.median(np.diff(imu.times_s)))
    count = max(2, round(_WINDOW_S / max(period_s, 1e-6)))
    windows = len(imu.times_s) // count - 1
    if windows < 3 or imu.times_s[-1] - imu.times_s[0] < 4 * _WINDOW_S:
        return None
    whole = slice(0, (windows + 1) * count)
    forces = imu.specific_force_m_s2[whole].reshape(windows + 1, count, 3).mean(1)
    rates = imu.angular_rate_rad_s[whole].reshape(windows + 1, count, 3).mean(1)
    shown = np.diff(forces, axis=0)
    expected = -np.cross(0.5 * (rates[1:] + rates[:-1]), 0.5 * (forces[1:] + forces[:-1])) * count * period_s
    return float(np.sqrt(np.mean(expected**2)) / max(float(np.sqrt(np.mean(shown**2))), 1e-9))


def _count(imu: ImuSamples, broken: Bools, source: str, code: str, what: str) -> list[Finding]:
    if not broken.any():
        return []
    first_s = float(imu.times_s[np.flatnonzero(broken)[0]])
    count = int(broken.sum())
    message = f"{source}: {count} samples left out, the first at {first_s:.3f} s: {what}"
    return [Finding(code, message, "note", {"samples": count, "first_s": first_s})]
