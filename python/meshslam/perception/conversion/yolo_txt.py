"""The text files of YOLO (`save_txt save_conf`, also of tracking): one an image, a line an instance."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from meshslam.errors import DetectionError
from meshslam.perception.coco import COCO_CLASSES
from meshslam.perception.conversion.class_numbers import class_note
from meshslam.perception.conversion.frames import Found, ImageFrames, files_in, frame_of, gathered, lines_of
from meshslam.perception.conversion.yolo_lines import Ends, Line, Shape, are_poses, ends_of, points_of_poses
from meshslam.perception.detections import DetectionSet
from meshslam.perception.json_values import LARGEST_NUMBER

_POSES = "key points and no masks: --yolo pose takes their boxes for masks, --yolo segment reads polygons all the same"


def from_yolo_txt(
    folder: Path,
    frames: ImageFrames,
    names: Sequence[str] | Mapping[int, str] | None = None,
    shape: Shape | None = None,
    tracked: bool | None = None,
) -> DetectionSet:
    """Read `class x1 y1 x2 y2 ... [score] [track]` with coordinates as shares of the image's size.

    `shape` says that lines are polygons (`segment`), boxes, or boxes with key points (`pose`), where boxes become the
    masks; `tracked` whether they end in a track. With None the lines of all files tell: boxes and poses are refused
    then. Without a score it is 1. `names` are those of the class numbers, COCO's if None. A file's name ends in its
    frame number. DetectionError names file and line.
    """
    table = dict(enumerate(COCO_CLASSES)) if names is None else _table(names)
    lines = []
    for path in files_in(folder, ".txt"):
        frame = frames.known(frame_of(path), str(path))
        lines += [Line(where, frame, tuple(words)) for where, words in lines_of(path)]
    if shape is None and are_poses(lines):
        raise DetectionError(f"{lines[0].where}: {_POSES}")
    found, ends = _read(lines, shape, tracked, frames, table)
    notes = class_note(folder, Counter(int(float(line.words[0])) for line in lines), table, given=names is not None)
    if shape is None and points_of_poses(lines) is not None:
        notes += (
            f"{folder}: lines are read as polygons, but may be boxes with key points: --yolo segment or pose tells",
        )
    return gathered(found, frames, notes=[*notes, *_notes(folder, found, ends, shape)])


def _table(names: Sequence[str] | Mapping[int, str]) -> dict[int, str]:
    return dict(names) if isinstance(names, Mapping) else dict(enumerate(names))


def _notes(folder: Path, found: Sequence[Found], ends: Ends, shape: Shape | None) -> list[str]:
    notes, tracks = [], {f.track_id for f in found} - {None}
    if tracks:
        notes.append(f"{folder}: the last numbers of lines are read as track ids ({len(tracks)} differ)")
    if ends.doubtful is not None:
        last = " ".join(ends.doubtful.words[-2:])
        notes.append(
            f"{ends.doubtful.where}: ends in {last}, read as a polygon's corner: --tracked says score and track"
        )
    if shape in ("boxes", "pose"):
        notes.append(f"{folder}: boxes are taken for masks ({len(found)}); outlines of cars need polygons")
    if shape == "pose":
        notes.append(f"{folder}: key points have no names in these files: they are left out")
    return notes


def _read(
    lines: Sequence[Line], shape: Shape | None, tracked: bool | None, frames: ImageFrames, names: Mapping[int, str]
) -> tuple[list[Found], Ends]:
    if shape == "pose":
        lines = _boxes_of_poses(lines)
    if shape in ("boxes", "pose"):
        for line in lines:
            if not 5 <= len(line.words) <= 7:
                raise DetectionError(
                    f"{line.where}: found {len(line.words)} numbers, expected a class, a box, score and track at most"
                )
    ends = ends_of(lines, tracked)
    return [_found(line, ends, frames, names, is_box=shape in ("boxes", "pose")) for line in lines], ends


def _boxes_of_poses(lines: Sequence[Line]) -> list[Line]:
    """The lines without their key points."""
    told = points_of_poses(lines)
    if told is None and lines:
        raise DetectionError(
            f"{lines[0].where}: --yolo pose: lines are no boxes with key points (x, y) or (x, y, v) inside"
        )
    _, behind = told or (0, 0)
    shortest = min((len(line.words) for line in lines), default=0)
    ends = {id(line): behind + len(line.words) - shortest for line in lines}
    return [
        Line(line.where, line.frame, line.words[:5] + line.words[len(line.words) - ends[id(line)] :]) for line in lines
    ]


def _found(line: Line, ends: Ends, frames: ImageFrames, names: Mapping[int, str], *, is_box: bool) -> Found:
    where, values = line.where, line.values()
    if len(values) < 5:
        raise DetectionError(f"{where}: found {len(values)} numbers, expected a class and at least three points")
    track = score = None
    if len(values) > 5 and ends.has_track(line):
        track = _track(values.pop(), where)
    if len(values) % 2 == 0:
        score = values.pop()
    if len(values) == 5 and not is_box:
        raise DetectionError(
            f"{where}: a box, no masks: expected a class and a polygon (of a network that segments); "
            "--yolo boxes takes boxes for masks"
        )
    if len(values) < (5 if is_box else 7):
        raise DetectionError(f"{where}: found {len(line.words)} numbers, expected a class and at least three points")
    category = _category(values[0], where, names)
    points = _corners(values[1:5]) if is_box else np.array(values[1:]).reshape(-1, 2)
    if points.min() < -0.01 or points.max() > 1.01 or not 0 <= (1.0 if score is None else score) <= 1:
        raise DetectionError(f"{where}: coordinates and score must lie between 0 and 1")
    polygon = (np.clip(points, 0, 1) * [frames.width, frames.height]).ravel().tolist()
    return Found(line.frame, category, 1.0 if score is None else score, [polygon], track)


def _corners(box: Sequence[float]) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """The corners (4, 2) of a box given by centre and size."""
    x, y, w, h = box
    return np.array([[x + i * w / 2, y + k * h / 2] for i, k in ((-1, -1), (1, -1), (1, 1), (-1, 1))])


def _category(index: float, where: str, names: Mapping[int, str]) -> str:
    if index != int(index) or int(index) not in names:
        known = ", ".join(map(str, sorted(names)[:3]))
        raise DetectionError(f"{where}: class {index:g}: expected one of {known} ... (--names gives names)")
    return names[int(index)]


def _track(value: float, where: str) -> int:
    if value != int(value) or not 0 <= value <= LARGEST_NUMBER:
        raise DetectionError(f"{where}: track {value:g}: expected an integer of at most 2^53")
    return int(value)
