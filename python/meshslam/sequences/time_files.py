"""The frames' times from a file of their own, for recordings whose frames carry none, or wrong ones."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from meshslam.geometry import Floats
from meshslam.sequences.report import Report, fail
from meshslam.sequences.text import LARGEST, check_increasing, read_text

_UNITS = {"s": 1.0, "sec": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9, "nsec": 1e9}  # how many make a second
_UNIT = re.compile(rf"[\[(_ ]({'|'.join(_UNITS)})[\])]?$", re.IGNORECASE)
_TIME = re.compile(r"time|stamp|sec|^t$|^t[\[(_ ]", re.IGNORECASE)
_STEPS_S = (0.002, 30.0)  # between frames: what is not within it is counted in another unit
_LATEST_S = 1e11  # the year 5138: what is more counts something smaller than seconds


def read_frame_times(path: Path, count: int, holder: Path, report: Report) -> Floats:
    """Times of the `count` frames of `holder`, seconds (count,), increasing.

    The file has one time a line, or a table with commas, semicolons or blanks between, whose first column is the
    time; lines that begin with # and one line of names are skipped. The unit is the header's (`[ns]`), else seconds or
    nanoseconds, which the steps between frames tell; all but seconds are noted. FoundError for a line without a time,
    times that do not rise, another number of times than frames, or steps that fit neither unit.
    """
    header, values, lines = _first_column(path)
    if len(values) != count:
        raise fail(path, "", f"holds {len(values)} times, but {holder.name} has {count} frames: give one time a frame")
    named = _UNIT.search(header)
    unit = _told_by_steps(path, values) if named is None else named[1].lower()
    if _UNITS[unit] != 1.0:
        report.note(
            path, "", f"times are taken as {unit}: {'by their steps' if named is None else 'the header says so'}"
        )
    times_s = values / _UNITS[unit]
    check_increasing(path, times_s, lines, report)
    return times_s


def _first_column(path: Path) -> tuple[str, Floats, tuple[int, ...]]:
    """The name of the first column, empty where there is none, its numbers, and their lines."""
    header, values, lines = "", [], []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        words = re.split(r"\s*[,;]\s*|\s+", line.strip().lstrip("#").strip(), maxsplit=0)
        value = None if line.strip().startswith("#") else _number(words[0])
        if value is not None:
            values.append(value)
            lines.append(number)
        elif words[0] and not values and not header:
            header = _name_of_times(path, number, line)
        elif words[0] and not line.strip().startswith("#"):
            raise fail(path, f"line {number}", f"expected a time, found {line.strip()[:60]!r}")
    return header, np.array(values, float), tuple(lines)


def _name_of_times(path: Path, number: int, line: str) -> str:
    """The first column's name; FoundError where it is another column that is called a time."""
    text = line.strip().lstrip("#").strip()
    names = [name.strip() for name in re.split(r"[,;]", text)] if re.search(r"[,;]", text) else [text]
    other = next((name for name in names if _TIME.search(name)), names[0])
    if other != names[0] and not _TIME.search(names[0]):
        raise fail(
            path, f"line {number}", f"the first column is {names[0][:40]!r}: put {other[:40]!r}, the time, first"
        )
    return names[0]


def _number(word: str) -> float | None:
    try:
        value = float(word)
    except ValueError:
        return None
    return value if abs(value) < LARGEST else None


def _told_by_steps(path: Path, values: Floats) -> str:
    step = float(np.median(np.abs(np.diff(values)))) if len(values) > 1 else 0.0
    latest = float(np.abs(values).max(initial=0.0))
    if step <= _STEPS_S[1] and latest < _LATEST_S:
        return "s"
    if _STEPS_S[0] <= step * 1e-9 <= _STEPS_S[1] or (not step and latest * 1e-9 < _LATEST_S):
        return "ns"
    steps = f"times up to {latest:.6g} in steps of {step:.6g} are neither seconds nor nanoseconds"
    raise fail(path, "", f"{steps}: write seconds, or a header with the unit, such as time [us]")
