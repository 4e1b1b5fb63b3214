"""What the operators of both frameworks share: checks that need no values, and words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from meshslam.errors import GeometryError

Method = Literal["exact", "kato"]

Part = tuple[str, Sequence[int], Sequence[int | None]]  # of `leading_shape`

NO_SECOND = (
    "meshslam's losses have first derivatives only: their second derivatives jump where the outline changes. "
    "Take a first-order optimizer, or stop the gradient before differentiating again"
)


def checked_method(gradient: Method) -> Method:
    """GeometryError for a method that there is not."""
    if gradient not in ("exact", "kato"):
        raise GeometryError(f"gradient is 'exact' or 'kato', found {gradient!r}")
    return gradient


def leading_shape(parts: Sequence[Part]) -> tuple[int, ...]:
    """The batch that arguments make, each (name, shape, its last dimensions, None for any length).

    GeometryError for a shape that does not end so, or batches that do not go together.
    """
    leading = []
    for name, shape, ends in parts:
        cut = len(shape) - len(ends)
        if cut < 0 or any(e is not None and n != e for n, e in zip(shape[cut:], ends, strict=True)):
            wanted = ", ".join(["...", *("any" if e is None else str(e) for e in ends)])
            raise GeometryError(f"{name} must have shape ({wanted}), found {tuple(shape)}")
        leading.append(tuple(shape[:cut]))
    try:
        return np.broadcast_shapes(*leading)
    except ValueError as error:
        raise GeometryError(f"batches of shapes {leading} do not go together") from error
