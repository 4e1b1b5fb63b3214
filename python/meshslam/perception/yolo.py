"""The layouts in which YOLO networks for instance segmentation are exported."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from meshslam.errors import ModelError
from meshslam.geometry import AnyArray, Floats
from meshslam.perception.candidates import Candidates, PrototypeMasks
from meshslam.perception.network_session import Dims, shapes_text

PYRAMIDS = ((8, 16, 32), (8, 16, 32, 64), (4, 8, 16, 32))  # strides of the grids on which candidates sit, px
KNOWN = "YOLOv5-seg, YOLOv8-seg and later, RF-DETR-seg, Mask R-CNN"
Kind = Literal["objectness", "columns", "rows"]
_NAMES: dict[Kind, str] = {"objectness": "YOLOv5-seg", "columns": "YOLOv8-seg", "rows": "finished YOLO rows"}


@dataclass(frozen=True)
class Layout:
    """How to read a network's outputs: where each part of a candidate is, and which output holds the prototypes.

    `kind` is `objectness` for candidates in rows with a column that multiplies every class score (v5), `columns` for
    candidates in columns (v8 and later), and `rows` for what the network has suppressed already: x0, y0, x1, y1, score,
    class and coefficients.
    """

    kind: Kind
    candidates: int  # index of the output
    prototypes: int
    classes: int | None  # None: the table does not tell

    @property
    def name(self) -> str:
        """Whose layout it is."""
        return _NAMES[self.kind]


def recognize(
    shapes: Sequence[Dims], size: tuple[int, int] | None, metadata: Mapping[str, str] | None = None
) -> Layout | None:
    """Tell the layout from the outputs' shapes for an input of `size` (height, width), and from the metadata.

    Sizes that are open are None. Returns None where too much of them is open; ModelError if they fit no layout.
    """
    said = metadata or {}
    flat = [i for i, s in enumerate(shapes) if len(s) == 3 and s[0] in (1, None)]
    deep = [i for i, s in enumerate(shapes) if len(s) == 4 and s[0] in (1, None)]
    for prototypes in deep:
        for candidates in flat:
            _, rows, columns = shapes[candidates]
            found = _of_table(rows, columns, shapes[prototypes][1], size, said)
            if found is not None:
                return Layout(found[0], candidates, prototypes, found[1])
    if size is None or not all(shapes) or any(None in shape for shape in shapes):
        return None
    raise ModelError(_problem(shapes, size, flat, deep, said))


def _of_table(
    rows: int | None, columns: int | None, depth: int | None, size: tuple[int, int] | None, said: Mapping[str, str]
) -> tuple[Kind, int | None] | None:
    """The kind and number of classes of a table, whose masks have `depth` coefficients."""
    if depth is None:
        return None
    cells = None if size is None else _cells(*size)
    if columns == 6 + depth and _is_finished(rows, cells, said):
        return "rows", None
    if columns is not None and columns > 5 + depth and _fits(rows, cells, 3):
        return "objectness", columns - 5 - depth
    if rows is not None and rows > 4 + depth and _fits(columns, cells, 1):
        return "columns", rows - 4 - depth
    return None


def _cells(height: int, width: int) -> set[int]:
    return {sum((height // s) * (width // s) for s in strides) for strides in PYRAMIDS}


def _fits(count: int | None, cells: set[int] | None, each: int) -> bool:
    """Whether a number of candidates is that of the grids; an open one is where sizes are open."""
    return count is None if cells is None else count in {each * n for n in cells}


def _is_finished(rows: int | None, cells: set[int] | None, said: Mapping[str, str]) -> bool:
    """Whether a table of as many columns holds finished rows: metadata say so, or its rows are not those of a v5."""
    if said.get("end2end") == "True" or _arguments(said).get("nms") is True:
        return True
    return rows is not None and (cells is None or not _fits(rows, cells, 3))


def _arguments(said: Mapping[str, str]) -> dict[str, object]:
    """What the exporter was told, as Ultralytics' metadata have it."""
    try:
        found = ast.literal_eval(said.get("args", "{}"))
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _problem(
    shapes: Sequence[Dims],
    size: tuple[int, int] | None,
    flat: Sequence[int],
    deep: Sequence[int],
    said: Mapping[str, str],
) -> str:
    task, found = said.get("task", "segment"), shapes_text(shapes)
    if task != "segment":
        return f"is of the task {task[:20]!r}, without masks: expected a network that segments (task segment, -seg)"
    if flat and not deep and len(shapes) == 1:
        return f"outputs {found}: boxes without masks: expected a network that segments (-seg)"
    asked = "" if size is None else f" for an input of {size[0]} x {size[1]}"
    return f"outputs {found}{asked} fit no known layout: {KNOWN}; others need an adapter"


def decode(outputs: Sequence[AnyArray], layout: Layout, score_threshold: float) -> Candidates:
    """Read the candidates whose best class scores at least `score_threshold`."""
    table = outputs[layout.candidates][0]
    if layout.kind == "rows":
        kept = table[table[:, 4] >= max(score_threshold, 1e-9)].astype(float)  # rows of zeros fill the table up
        boxes, scores, classes, first = kept[:, :4], kept[:, 4], kept[:, 5].astype(int), 6
    else:
        kept, scores, classes = _best(table, layout, score_threshold)
        boxes, first = (
            _corners(kept[:, :4].astype(float)),
            (layout.classes or 0) + (5 if layout.kind == "objectness" else 4),
        )
    masks = PrototypeMasks(kept[:, first:].astype(float), outputs[layout.prototypes][0].astype(np.float32))
    return Candidates(boxes, classes, scores, masks)


def _best(table: AnyArray, layout: Layout, score_threshold: float) -> tuple[AnyArray, Floats, AnyArray]:
    """Rows of candidates whose best class scores enough, with that score and class."""
    with_objectness = layout.kind == "objectness"
    rows, first = (table, 5) if with_objectness else (table.T, 4)
    if with_objectness:
        rows = rows[rows[:, 4] >= score_threshold]  # a product of confidences is below each of them
    chances = rows[:, first : first + (layout.classes or 0)]
    if with_objectness:
        chances = chances * rows[:, 4:5]
    classes = chances.argmax(1)
    scores = np.take_along_axis(chances, classes[:, None], 1)[:, 0]
    keep = scores >= score_threshold
    return rows[keep], scores[keep].astype(float), classes[keep]


def _corners(boxes: Floats) -> Floats:
    """Boxes x0, y0, x1, y1 of centres and sizes."""
    half = boxes[:, 2:] / 2
    return np.concatenate([boxes[:, :2] - half, boxes[:, :2] + half], 1)
