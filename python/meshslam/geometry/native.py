"""How arrays cross to the native module: contiguous, of its types, its errors as GeometryError."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry.arrays import AnyArray, Floats, Ints


def floats(values: AnyArray) -> Floats:
    """Contiguous float64."""
    return np.ascontiguousarray(values, np.float64)


def ints(values: AnyArray) -> Ints:
    """Contiguous int64."""
    return np.ascontiguousarray(values, np.int64)


@contextmanager
def geometry_errors() -> Iterator[None]:
    """Turn what the native module raises into GeometryError with the same words."""
    try:
        yield
    except (ValueError, IndexError, TypeError, OverflowError) as error:
        raise_as_geometry_error(error)


def raise_as_geometry_error(error: Exception) -> NoReturn:
    """Raise what the native module raised as GeometryError with the same words."""
    if isinstance(error, GeometryError):
        raise error
    raise GeometryError(str(error)) from error
