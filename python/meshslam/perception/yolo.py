"""The layouts in which YOLO networks for instance segmentation are exported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from meshslam.errors import ModelError
from meshslam.geometry import AnyArray, Floats

PYRAMIDS = ((8, 16, 32), (8, 16, 32, 64), (4, 8, 16, 32))  # strides of the grids on which candidates sit, px
KNOWN = (
    "YOLOv5-seg: (1, N, 5 + classes + M) with N = 3 per grid cell, and prototypes (1, M, height/4, width/4)",
    "YOLOv8-seg and YOLO11-seg: (1, 4 + classes + M, N) with N = 1 per grid cell, and prototypes likewise",
)


@dataclass(frozen=True)
class Layout:
    """How to read a network's outputs: where each part of a candidate is, and which output holds the prototypes."""

    name: str
    candidates: int  # index of the output
    prototypes: int
    classes: int
    objectness: bool  # v5 has a column that multiplies every class score, and candidates in rows


@dataclass(frozen=True, eq=False)
class Candidates:
    """What a network says before anything is suppressed, in pixels of its input."""

    boxes: Floats  # (N, 4) x0, y0, x1, y1
    classes: AnyArray  # (N,) index of the best class
    scores: Floats  # (N,)
    coefficients: Floats  # (N, M)
    prototypes: Floats  # (M, height, width)

    def subset(self, keep: AnyArray) -> Candidates:
        """Return the candidates that a mask or indices choose."""
        return replace(
            self,
            boxes=self.boxes[keep],
            classes=self.classes[keep],
            scores=self.scores[keep],
            coefficients=self.coefficients[keep],
        )


def recognize(shapes: Sequence[Sequence[int]], height: int, width: int) -> Layout:
    """Tell the layout from the outputs' shapes for an input of `height` x `width`; ModelError if it fits none."""
    flat = [i for i, s in enumerate(shapes) if len(s) == 3 and s[0] == 1]
    deep = [i for i, s in enumerate(shapes) if len(s) == 4 and s[0] == 1]
    cells = {sum((height // s) * (width // s) for s in strides) for strides in PYRAMIDS}
    for prototypes in deep:
        size = shapes[prototypes][1]
        for candidates in flat:
            _, rows, columns = shapes[candidates]
            if rows in {3 * n for n in cells} and columns > 5 + size:
                return Layout("YOLOv5-seg", candidates, prototypes, columns - 5 - size, objectness=True)
            if columns in cells and rows > 4 + size:
                return Layout("YOLOv8-seg", candidates, prototypes, rows - 4 - size, objectness=False)
    found = ", ".join(str(tuple(s)) for s in shapes)
    known = "; ".join(KNOWN)
    raise ModelError(f"outputs {found} for an input of {height} x {width} fit no known layout; known are {known}")


def decode(outputs: Sequence[AnyArray], layout: Layout, score_threshold: float) -> Candidates:
    """Read the candidates whose best class scores at least `score_threshold`."""
    table = outputs[layout.candidates][0]
    rows = table if layout.objectness else table.T
    first = 5 if layout.objectness else 4
    if layout.objectness:
        rows = rows[rows[:, 4] >= score_threshold]  # a product of confidences is below each of them
    chances = rows[:, first : first + layout.classes]
    if layout.objectness:
        chances = chances * rows[:, 4:5]
    classes = chances.argmax(1)
    scores = np.take_along_axis(chances, classes[:, None], 1)[:, 0]
    keep = scores >= score_threshold
    centre, half = rows[keep, :2].astype(float), rows[keep, 2:4].astype(float) / 2
    return Candidates(
        boxes=np.concatenate([centre - half, centre + half], 1),
        classes=classes[keep],
        scores=scores[keep].astype(float),
        coefficients=rows[keep, first + layout.classes :].astype(float),
        prototypes=outputs[layout.prototypes][0].astype(np.float32),
    )
