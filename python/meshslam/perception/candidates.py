"""What a network says of a window of an image before anything is suppressed, in pixels of its input."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from meshslam.geometry import AnyArray, Floats, Singles

Extent = tuple[float, float, float, float]  # x0, y0, x1, y1: px of the input


class Masks(Protocol):
    """The masks of candidates: logits on grids."""

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of every grid."""
        ...

    def extent(self, row: int) -> Extent | None:
        """The part of the input that a candidate's grid covers; None for all of it."""
        ...

    def logits(self, row: int, rows: slice, columns: slice) -> Singles:
        """A part of one candidate's grid; positive where the object is."""
        ...

    def subset(self, keep: AnyArray) -> Masks:
        """The masks of the candidates that a mask or indices choose."""
        ...


@dataclass(frozen=True, eq=False)
class PrototypeMasks:
    """Masks that are sums of prototypes, over the whole input."""

    coefficients: Floats  # (N, M)
    prototypes: Singles  # (M, height, width)

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of the prototypes."""
        return self.prototypes.shape[1], self.prototypes.shape[2]

    def extent(self, row: int) -> Extent | None:
        """None: they cover the input."""
        return None

    def logits(self, row: int, rows: slice, columns: slice) -> Singles:
        """The sum in a part of the grid."""
        found: Singles = np.tensordot(self.coefficients[row].astype(np.float32), self.prototypes[:, rows, columns], 1)
        return found

    def subset(self, keep: AnyArray) -> PrototypeMasks:
        """Those of chosen candidates."""
        return replace(self, coefficients=self.coefficients[keep])


@dataclass(frozen=True, eq=False)
class GridMasks:
    """A grid for each candidate: over the whole input, or over the candidate's box."""

    values: Singles  # (N, height, width), logits or probabilities over `border`
    border: float = 0.0  # of the object
    boxes: Floats | None = None  # (N, 4): what grids cover; None: the input

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.values.shape[1], self.values.shape[2]

    def extent(self, row: int) -> Extent | None:
        """The box, if grids are in boxes."""
        if self.boxes is None:
            return None
        x0, y0, x1, y1 = self.boxes[row].tolist()
        return x0, y0, x1, y1

    def logits(self, row: int, rows: slice, columns: slice) -> Singles:
        """A part of one grid."""
        return np.asarray(self.values[row, rows, columns], np.float32) - np.float32(self.border)

    def subset(self, keep: AnyArray) -> GridMasks:
        """Those of chosen candidates."""
        boxes = None if self.boxes is None else self.boxes[keep]
        return replace(self, values=self.values[keep], boxes=boxes)


@dataclass(frozen=True, eq=False)
class Candidates:
    """What a network says of a window, in pixels of its input."""

    boxes: Floats  # (N, 4) x0, y0, x1, y1
    classes: AnyArray  # (N,) index of the best class
    scores: Floats  # (N,)
    masks: Masks

    def subset(self, keep: AnyArray) -> Candidates:
        """Return the candidates that a mask or indices choose."""
        masks = self.masks.subset(keep)
        return Candidates(self.boxes[keep], self.classes[keep], self.scores[keep], masks)
