"""What the lines of YOLO's text files hold: polygons, boxes or key points, and what their last numbers are.

One line alone often does not tell; the lines of all files together do.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from meshslam.geometry import Floats
from meshslam.perception.conversion.frames import numbers_of

Shape = Literal["segment", "pose", "boxes"]
_ID = re.compile(r"\d{1,16}", re.ASCII)  # as trackers write it: no dot
_BORDER = 0.01  # share of the image's height within which a point is at its border
_BOX = 5  # a class, and centre and size of a box
_FILLED = 0.5  # share of a pose's box that its points extend over, at least
MANY = 8  # lines, of which not all are polygons that read as poses
_LONG_WAY = 1.5  # of the sides of the box around an outline
_FAR = 10.0  # shares of the image
_MARGIN = 0.1  # of a box's size, by which points may lie outside


@dataclass(frozen=True)
class Line:
    """One instance as it stands in a file."""

    where: str
    frame: int
    words: tuple[str, ...]

    @property
    def has_pairs(self) -> bool:
        """Whether a class and pairs of numbers are all: a polygon alone, or one with confidence and track."""
        return len(self.words) % 2 == 1

    @property
    def ends_in_id(self) -> bool:
        """Whether the last word may be a track's number."""
        return _ID.fullmatch(self.words[-1]) is not None

    def values(self) -> list[float]:
        """The words as numbers; DetectionError where one is none."""
        return numbers_of(self.words, self.where)

    def shares(self) -> Floats:
        """The numbers behind the class, within what geometry needs of them: far outside is far enough."""
        return np.clip(self.values()[1:], -_FAR, _FAR)


@dataclass(frozen=True)
class Ends:
    """What the last words of lines are, decided over all files."""

    pairs_have_track: bool  # class, polygon, confidence, track
    last_is_track: bool  # class, polygon, track; otherwise class, polygon, confidence
    doubtful: Line | None = None  # one whose last point may be a confidence and a track

    def has_track(self, line: Line) -> bool:
        """Whether a line ends in a track."""
        return self.pairs_have_track if line.has_pairs else self.last_is_track


def ends_of(lines: Sequence[Line], tracked: bool | None = None) -> Ends:
    """What polygons and boxes are followed by; `tracked` says whether tracks are there, None: the lines tell."""
    pairs = [line for line in lines if line.has_pairs and len(line.words) > _BOX + 1]
    single = [line for line in lines if not line.has_pairs]
    if tracked is not None:
        return Ends(tracked, tracked and bool(single) and all(line.ends_in_id for line in single))
    both = pairs if pairs and all(line.ends_in_id and _is_share(line.words[-2]) for line in pairs) else []
    is_track = any(_cannot_be_point(line) for line in both)
    return Ends(is_track, _last_is_track(single), both[0] if both and not is_track else None)


def _is_share(word: str) -> bool:
    try:
        return 0 <= float(word) <= 1
    except ValueError:
        return False


def _cannot_be_point(line: Line) -> bool:
    """Whether the last two numbers are no corner: far below the image, or a spike to its border far from the others."""
    *before, x, y = line.shares().tolist()
    if y > 1:
        return True
    others = np.array(before).reshape(-1, 2)
    width = max(np.ptp(others[:, 0]), _BORDER)
    beside = others[:, 0].min() - width <= x <= others[:, 0].max() + width
    return not beside or bool((np.abs(others[:, 1] - y) > _BORDER).all())


def _last_is_track(lines: Sequence[Line]) -> bool:
    """Whether lines with one number behind their pairs end in a track: integers, which one frame has once each."""
    if not lines or not all(line.ends_in_id for line in lines):
        return False
    counts = Counter((line.frame, line.words[-1]) for line in lines)
    largest = max(int(line.words[-1]) for line in lines)
    return largest > 1 or (largest == 1 and max(counts.values()) == 1)


def are_poses(lines: Sequence[Line]) -> bool:
    """Whether all lines read as boxes that their key points fill, and not as polygons.

    Some polygons read so, too, but not many in a row; their second corner is near the others, as a box's size is
    not, and they go around.
    """
    told = points_of_poses(lines)
    if told is None:
        return False
    count = min(len(line.words) for line in lines) - told[1]
    away = sum(_has_size_away(line, told[0], count) or _jumps(line) for line in lines)
    return away > len(lines) / 2 or len(lines) >= MANY


def points_of_poses(lines: Sequence[Line]) -> tuple[int, int] | None:
    """Numbers for each key point, 3 or 2, and numbers behind them in the shortest lines; None if none fit all lines."""
    counts = {len(line.words) for line in lines}
    if not counts or max(counts) - min(counts) > 2:
        return None
    for each in (3, 2):
        for behind in (0, 1, 2):
            rest = min(counts) - _BOX - behind
            if rest > each and rest % each == 0 and all(_fill_box(line, each, rest) for line in lines):
                return each, behind
    return None


def _fill_box(line: Line, each: int, count: int) -> bool:
    values = line.shares()[: _BOX + count - 1]
    box, points = values[:4], values[4:].reshape(-1, each)
    seen: Floats = points[(points[:, :2] != 0).any(1) & (points[:, -1] > 0 if each == 3 else True)]
    if each == 3 and (points[:, 2].min() < 0 or points[:, 2].max() > 2):
        return False
    if len(seen) < 2:
        return True
    inside = np.abs(seen[:, :2] - box[:2]) <= box[2:] * (0.5 + _MARGIN)
    return bool(inside.all() and (np.ptp(seen[:, :2], axis=0) >= _FILLED * box[2:]).any())


def _has_size_away(line: Line, each: int, count: int) -> bool:
    """Whether a box's size, taken for a point, is away from its centre and its key points, up to word `count`."""
    values = line.shares()[: count - 1]
    size, points = values[2:4], np.vstack([values[:2], values[4:].reshape(-1, each)[:, :2]])
    low, high = points.min(0), points.max(0)
    return bool(((size < low - (high - low)) | (size > high + (high - low))).any())


def _jumps(line: Line) -> bool:
    """Whether the way along a line's pairs is long against the box around them: an outline's is not."""
    points = line.shares()[: (len(line.words) - 1) // 2 * 2].reshape(-1, 2)
    way = np.linalg.norm(np.diff(points, axis=0, append=points[:1]), axis=1).sum()
    return bool(way > _LONG_WAY * 2 * np.ptp(points, axis=0).sum())
