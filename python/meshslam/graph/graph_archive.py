"""A graph as plain arrays, and back, to the last bit: variables, what factors were made of, and linear factors.

Rows |A x - b| are in GTSAM's tangent spaces at the values that are saved with them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import gtsam
import numpy as np

from meshslam.geometry import AnyArray, Floats, Ints
from meshslam.graph.records import KINDS, Record
from meshslam.graph.window import Linearized

Arrays = dict[str, Any]

_POSES = "xo"  # kinds of variables, by the first letter of their key
_VECTORS = "vtsz"


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
        return gtsam.Pose3(row.reshape(4, 4))
    if kind == "e":
        return gtsam.Rot3(row.reshape(3, 3))
    return gtsam.imuBias.ConstantBias(row[:3], row[3:]) if kind == "b" else row


def records_to_arrays(records: Sequence[Record]) -> Arrays:
    """Records behind each other."""
    return {
        "kinds": np.array([KINDS.index(r.kind) for r in records], np.int64),
        "key_counts": np.array([len(r.keys) for r in records], np.int64),
        "keys": np.array([key for r in records for key in r.keys], np.uint64),
        "number_counts": np.array([len(r.numbers) for r in records], np.int64),
        "numbers": np.concatenate([np.zeros(0), *(r.numbers for r in records)]),
    }


def records_from_arrays(arrays: Mapping[str, Any]) -> Iterator[Record]:
    """The reverse of `records_to_arrays`."""
    keys = _split(arrays["keys"], arrays["key_counts"])
    numbers = _split(arrays["numbers"], arrays["number_counts"])
    for kind, some, values in zip(arrays["kinds"].tolist(), keys, numbers, strict=True):
        yield Record(KINDS[kind], tuple(some.tolist()), values)


def linear_to_arrays(factors: Sequence[Linearized]) -> Arrays:
    """Linear factors behind each other, each with the values that it is linear about."""
    at = [np.concatenate([_plain(f.at, key).ravel() for key in f.keys]) for f in factors]
    return {
        "key_counts": np.array([len(f.keys) for f in factors], np.int64),
        "keys": np.array([key for f in factors for key in f.keys], np.uint64),
        "shapes": np.array([f.rows.shape for f in factors], np.int64).reshape(-1, 2),
        "rows": np.concatenate([np.zeros(0), *(f.rows.ravel() for f in factors)]),
        "at": np.concatenate([np.zeros(0), *at]),
        "widths": np.array([_plain(f.at, key).size for f in factors for key in f.keys], np.int64),
    }


def linear_from_arrays(arrays: Mapping[str, Any]) -> Iterator[Linearized]:
    """The reverse of `linear_to_arrays`."""
    shapes = arrays["shapes"]
    rows = _split(arrays["rows"], shapes.prod(axis=1))
    held = iter(zip(arrays["keys"].tolist(), _split(arrays["at"], arrays["widths"]), strict=True))
    for count, shape, own in zip(arrays["key_counts"].tolist(), shapes.tolist(), rows, strict=True):
        some = [next(held) for _ in range(count)]
        at = gtsam.Values()
        for key, numbers in some:
            at.insert(key, _variable(_kind(key), numbers))
        yield Linearized(tuple(key for key, _ in some), np.asfortranarray(own.reshape(shape)), at)


def _split(values: AnyArray, counts: Ints) -> list[AnyArray]:
    """Parts of an array, so many numbers each; ValueError if they are not all of it."""
    ends = np.cumsum(counts)
    if len(values) != (ends[-1] if len(ends) else 0):
        raise ValueError(f"{len(values)} numbers, expected {ends[-1] if len(ends) else 0}")
    return np.split(values, ends[:-1]) if len(ends) else []
