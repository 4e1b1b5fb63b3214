"""A graph as plain arrays, and back: variables by kind, factors as rows |A x - b| about their values.

Rows are in GTSAM's tangent spaces at the values that are saved with them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from meshslam.geometry import Floats
from meshslam.graph.window import rows_factor

Arrays = dict[str, Any]

_POSES = "xo"  # kinds of variables, by the first letter of their key
_VECTORS = "vtsz"
_WIDTHS = {"x": 6, "o": 6, "b": 6, "e": 3}  # of a step; a vector's is its own


def values_to_arrays(values: gtsam.Values) -> Arrays:
    """Each kind of variable stacked, beside its numbers."""
    kinds: dict[str, list[int]] = {}
    for key in values.keys():  # noqa: SIM118 # no mapping
        kinds.setdefault(_kind(key), []).append(key)
    arrays: Arrays = {}
    for kind, keys in kinds.items():
        arrays[f"{kind}_keys"] = np.array(keys, np.uint64)
        arrays[kind] = np.array([_plain(values, key) for key in keys])
    return arrays


def values_from_arrays(arrays: Mapping[str, Any]) -> gtsam.Values:
    """The reverse of `values_to_arrays`."""
    values = gtsam.Values()
    for kind in (*_POSES, *_VECTORS, "b", "e"):
        for key, row in zip(arrays.get(f"{kind}_keys", ()), arrays.get(kind, ()), strict=True):
            values.insert(int(key), _variable(kind, np.asarray(row, float)))
    return values


def _kind(key: int) -> str:
    return chr(gtsam.Symbol(key).chr())


def _plain(values: gtsam.Values, key: int) -> Floats:
    kind = _kind(key)
    if kind in _VECTORS:
        return values.atVector(key)
    if kind in _POSES:
        return values.atPose3(key).matrix()
    return values.atRot3(key).matrix() if kind == "e" else values.atConstantBias(key).vector()


def _variable(kind: str, row: Floats) -> Any:  # noqa: ANN401 # one of GTSAM's types
    if kind in _POSES:
        return gtsam.Pose3(row)
    if kind == "e":
        return gtsam.Rot3(row)
    return gtsam.imuBias.ConstantBias(row[:3], row[3:]) if kind == "b" else row


@dataclass(frozen=True, eq=False)
class Rows:
    """A linear factor: keys in the order of its columns, [A b]."""

    keys: tuple[int, ...]
    rows: Floats


def rows_of(factor: gtsam.NonlinearFactor, values: gtsam.Values) -> Rows:
    """A factor, linearized."""
    linear = factor.linearize(values)
    return Rows(tuple(linear.keys()), np.asarray(linear.augmentedJacobian()))


def factor_of(linear: Rows, values: gtsam.Values) -> gtsam.LinearContainerFactor:
    """The factor of these rows about these values."""
    keys = [(key, _WIDTHS.get(_kind(key)) or values.atVector(key).size) for key in linear.keys]
    return rows_factor(keys, linear.rows, values)


def rows_to_arrays(factors: Sequence[Rows]) -> Arrays:
    """Factors behind each other."""
    return {
        "key_counts": np.array([len(f.keys) for f in factors], np.int64),
        "keys": np.array([key for f in factors for key in f.keys], np.uint64),
        "shapes": np.array([f.rows.shape for f in factors], np.int64).reshape(-1, 2),
        "rows": np.concatenate([np.zeros(0), *(f.rows.ravel() for f in factors)]),
    }


def rows_from_arrays(arrays: Mapping[str, Any]) -> Iterator[Rows]:
    """The reverse of `rows_to_arrays`."""
    at_key = at_row = 0
    for count, (height, width) in zip(arrays["key_counts"].tolist(), arrays["shapes"].tolist(), strict=True):
        keys = tuple(int(key) for key in arrays["keys"][at_key : at_key + count])
        yield Rows(keys, arrays["rows"][at_row : at_row + height * width].reshape(height, width))
        at_key, at_row = at_key + count, at_row + height * width
