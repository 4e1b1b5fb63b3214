"""What a live driver sends, before it changes anything: samples sorted, broken ones left out, stamps judged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.errors import SequenceError
from meshslam.plausibility import FRAME_STEP_S, SAMPLE_STEP_S, frozen_samples, judge_imu, judge_times, wild_samples
from meshslam.sequences import ImuSamples

NO_SAMPLES = ImuSamples(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
LONGEST_STEP_S: float = FRAME_STEP_S[1]  # between frames that no samples join
_LATEST_S = 1e11  # a clock in seconds that says more counts something else
JUDGED_S = (1.0, 5.0)  # seconds of samples that the judgement of units needs, and after which it ends
_TAIL = 4  # held samples that show whether the first new ones repeat them
_NAMES = ("times_s", "angular_rate_rad_s", "specific_force_m_s2")


@dataclass(frozen=True, eq=False)
class Arrived:
    """Samples that can be used, sorted, each time once; and what was done to them."""

    samples: ImuSamples
    notes: tuple[str, ...]


def checked_time(frame: int, time_s: float, last_s: float | None, newest_sample_s: float | None) -> float:
    """The frame's time; SequenceError if it is no number, does not go on, or jumps ahead of all samples."""
    if isinstance(time_s, bool) or not isinstance(time_s, int | float | np.integer | np.floating):
        raise SequenceError(f"frame {frame}: its time is {type(time_s).__name__}, expected seconds as a number")
    if not np.isfinite(time_s) or abs(time_s) > _LATEST_S:
        raise SequenceError(f"frame {frame}: its time is {time_s:.6g}, expected seconds: nanoseconds, or no clock?")
    if last_s is None:
        return float(time_s)
    if not time_s > last_s:
        raise SequenceError(
            f"frame {frame}: its time {time_s:.6f} s is not after {last_s:.6f} s, that of the frame before: leave it "
            "out, or begin anew if the clock was set back"
        )
    reached_s = last_s if newest_sample_s is None else max(last_s, newest_sample_s)
    if time_s - reached_s > LONGEST_STEP_S:
        raise SequenceError(
            f"frame {frame}: its time {time_s:.6f} s is {time_s - last_s:.3g} s after the frame before, and no samples "
            f"reach to within {LONGEST_STEP_S:g} s: stamps in another unit, or a clock that jumped: begin anew if not"
        )
    return float(time_s)


def checked_samples(frame: int, imu: ImuSamples | None) -> ImuSamples:
    """Samples as arrays of numbers (n,), (n, 3), (n, 3); SequenceError if they are none."""
    if imu is None:
        return NO_SAMPLES
    if not isinstance(imu, ImuSamples):
        raise SequenceError(f"frame {frame}: imu is {type(imu).__name__}, expected ImuSamples")
    try:
        times_s, rates, forces = (np.asarray(getattr(imu, name), float) for name in _NAMES)
    except (TypeError, ValueError):
        raise SequenceError(f"frame {frame}: IMU samples hold what is no number") from None
    if times_s.ndim != 1 or rates.shape != (len(times_s), 3) or forces.shape != rates.shape:
        found = f"{times_s.shape}, {rates.shape}, {forces.shape}"
        raise SequenceError(f"frame {frame}: IMU samples have shapes {found}, expected (n,), (n, 3), (n, 3)")
    return ImuSamples(times_s, rates, forces)


def arrived(
    frame: int, time_s: float, last_s: float | None, held: ImuSamples, imu: ImuSamples, *, is_live: bool = True
) -> Arrived:
    """The samples of a frame: sorted, doubled ones once, broken ones left out as if they had not been measured.

    `held` are those of the frames before. In a live stream those that jump far ahead of the frame are left out: all
    later ones would seem old beside them. SequenceError if all are of before the last frame, or none is near this one.
    """
    if not len(imu.times_s):
        return Arrived(imu, ())
    readings = np.hstack([imu.angular_rate_rad_s, imu.specific_force_m_s2])
    numbers = np.isfinite(imu.times_s) & np.isfinite(readings).all(axis=1)
    wild = numbers & wild_samples(imu)
    if numbers.any():
        _on_the_same_clock(frame, time_s, last_s, imu.times_s[numbers])
    sane = _picked(imu, numbers & ~wild)
    sane = _picked(sane, np.unique(sane.times_s, return_index=True)[1])
    ahead = _far_ahead(time_s, sane.times_s) if is_live else np.zeros(len(sane.times_s), bool)
    sane = _picked(sane, ~ahead)
    frozen = _frozen(held, sane)
    counts = {
        "are no numbers": int((~numbers).sum()),
        "are wild, over 10 g or 35 rad/s": int(wild.sum()),
        "are far ahead of the frame": int(ahead.sum()),
        "repeat the same reading": int(frozen.sum()),
    }
    notes = tuple(f"frame {frame}: {n} IMU samples left out: they {what}" for what, n in counts.items() if n)
    return Arrived(_picked(sane, ~frozen), notes)


def units_judged(frame: int, recent: ImuSamples, source: str) -> tuple[bool, tuple[str, ...]]:
    """Whether the first seconds' samples suffice to judge units, so that they need not be held, and what to note.

    SequenceError where the specific force is in g, without gravity, or swapped with the rates. Rates that look like
    degrees are noted: a vehicle at rest tells little of them.
    """
    seconds = recent.times_s[-1] - recent.times_s[0] if len(recent.times_s) > 1 else 0.0
    if seconds < JUDGED_S[0]:
        return False, ()
    found = judge_imu(recent, f"{source}, frame {frame}: IMU")
    for finding in found:
        if finding.severity == "error" and finding.code not in ("imu_in_degrees", "times_unit"):
            raise SequenceError(f"{finding.message}; begin anew with right samples: the poses so far are wrong")
    enough = bool(seconds >= JUDGED_S[1])
    return enough, tuple(f.message for f in found if f.code == "imu_in_degrees") if enough else ()


def joined(one: ImuSamples, other: ImuSamples) -> ImuSamples:
    """Samples one after the other."""
    return ImuSamples(*(np.concatenate([getattr(one, name), getattr(other, name)]) for name in _NAMES))


def _on_the_same_clock(frame: int, time_s: float, last_s: float | None, times_s: np.ndarray) -> None:
    first, last = float(times_s.min()), float(times_s.max())
    between = f"frame {frame}: its {len(times_s)} IMU samples are from {first:.6g} s to {last:.6g} s"
    tells = len(times_s) > 2 or last - first > 100 * LONGEST_STEP_S
    unit = judge_times(np.unique(times_s), "IMU samples", f"frame {frame}", SAMPLE_STEP_S) if tells else []
    if unit and "look like" in unit[0].message:
        raise SequenceError(unit[0].message)
    if first > time_s + LONGEST_STEP_S or last < time_s - LONGEST_STEP_S:
        raise SequenceError(f"{between}, the frame is at {time_s:.6g} s: another clock or unit: all times are seconds")
    if last_s is not None and last <= last_s:
        raise SequenceError(
            f"{between}, all before the last frame at {last_s:.6f} s: they come too late: give each frame the samples "
            "since the last one, up to its own time"
        )


def _far_ahead(time_s: float, times_s: np.ndarray) -> np.ndarray:
    """Which of sorted times come after a jump ahead of the frame."""
    jumps = np.diff(np.concatenate([[time_s], times_s])) > LONGEST_STEP_S
    return np.logical_or.accumulate(jumps & (times_s > time_s + LONGEST_STEP_S))


def _frozen(held: ImuSamples, new: ImuSamples) -> np.ndarray:
    tail = _picked(held, slice(max(0, len(held.times_s) - _TAIL), None))
    return frozen_samples(joined(tail, new))[len(tail.times_s) :]


def _picked(imu: ImuSamples, keep: np.ndarray | slice) -> ImuSamples:
    return ImuSamples(*(getattr(imu, name)[keep] for name in _NAMES))
