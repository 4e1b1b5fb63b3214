"""A part of a recording's frames, by numbers or by times."""

from __future__ import annotations

import re
from collections.abc import Sequence as Items
from dataclasses import dataclass, replace

from meshslam.errors import SequenceError
from meshslam.sequences.report import Report
from meshslam.sequences.sequence import Sequence

_RANGE = re.compile(r"(\d*):(\d*)(?::(\d+))?", re.ASCII)
_SIZE = re.compile(r"([1-9]\d{0,4})x([1-9]\d{0,4})", re.ASCII)
TOPICS = ("image", "camera", "imu", "poses")  # what a bag's topic can be
_SECONDS = re.compile(r"(\d+(?:\.\d*)?|\.\d+)s?", re.ASCII)


@dataclass(frozen=True)
class Selection:
    """Frame numbers `first:end:stride` (end is not in it), and seconds after the first frame; None is no limit."""

    first: int | None = None
    end: int | None = None
    stride: int = 1
    from_s: float | None = None
    to_s: float | None = None


def read_selection(frames: str | None) -> Selection:
    """Frames from a text such as 100:600:2; SequenceError says what was expected.

    >>> read_selection("100:600:2")
    Selection(first=100, end=600, stride=2, from_s=None, to_s=None)
    """
    if frames is None:
        return Selection()
    match = _RANGE.fullmatch(frames.strip())
    if match is None or match[3] == "0" or max(map(len, match.groups(""))) > 15:
        raise SequenceError(f"--frames {frames!r:.60}: expected FIRST:END or FIRST:END:STRIDE, such as 100:600:2")
    first, end = (int(text) if text else None for text in match.groups()[:2])
    return Selection(first, end, int(match[3] or 1))


def read_seconds(text: str) -> float:
    """Seconds from a text such as 12.5s or 12.5; SequenceError says what was expected."""
    match = _SECONDS.fullmatch(text.strip())
    if match is None or len(text) > 30:
        raise SequenceError(f"{text!r:.60}: expected seconds after the first frame, such as 12.5s")
    return float(match[1])


def read_size(text: str) -> tuple[int, int]:
    """Width and height from a text such as 640x480; SequenceError says what was expected."""
    match = _SIZE.fullmatch(text.strip())
    if match is None:
        raise SequenceError(f"size {text!r:.60}: expected WIDTHxHEIGHT in pixels, such as 640x480")
    return int(match[1]), int(match[2])


def read_topics(given: Items[str]) -> dict[str, str]:
    """Topics by what they are, from texts such as image=/camera/image_raw; SequenceError says what was expected."""
    found = {}
    for text in given:
        what, sign, topic = text.partition("=")
        if not sign or what not in TOPICS or not topic:
            raise SequenceError(
                f"topic {text!r:.80}: expected one of {', '.join(TOPICS)}, such as image=/camera/image_raw"
            )
        found[what] = topic
    return found


def selected(sequence: Sequence, chosen: Selection, report: Report) -> Sequence:
    """That part of a recording, noted; SequenceError if no frame is left."""
    if chosen == Selection():
        return sequence
    numbers, after_s = sequence.frame_ids, sequence.times_s - sequence.times_s[0]
    inside = [
        i
        for i, (number, time_s) in enumerate(zip(numbers, after_s.tolist(), strict=True))
        if (chosen.first is None or number >= chosen.first)
        and (chosen.end is None or number < chosen.end)
        and (chosen.from_s is None or time_s >= chosen.from_s)
        and (chosen.to_s is None or time_s <= chosen.to_s)
    ][:: chosen.stride]
    if not inside:
        raise SequenceError(
            f"{sequence.root}: no frame is chosen: it has the frames {numbers[0]} to {numbers[-1]}, "
            f"0 s to {after_s[-1]:.2f} s"
        )
    report.note(sequence.root, "", f"{len(inside)} of {len(numbers)} frames are chosen: {_span(sequence, inside)}")
    part = sequence.part(inside)
    start = sequence.initial_state
    if start is not None and abs(start.time_s - float(part.times_s[0])) > _START_S:
        report.note(sequence.root, "", "the initial state is of another time than the first chosen frame: not used")
        part = replace(part, initial_state=None)
    return part


_START_S = 0.05  # by which an initial state may be of another time than the first frame


def _span(sequence: Sequence, inside: list[int]) -> str:
    return f"{sequence.frame_ids[inside[0]]} to {sequence.frame_ids[inside[-1]]}"
