"""The columns of a tile's table: what is known of each object beside its mesh."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from meshslam.categories import Category
from meshslam.geometry import Bools, Floats, Ints, Pose
from meshslam.maps.mesh_code import STEP_M, Arrays
from meshslam.maps.objects import MapObject

_KEYPOINT_TOLERANCE_M = 1e-5
_NO_KEYPOINTS, _KEYPOINTS_OF_MESH, _OWN_KEYPOINTS = range(3)
_UPPER = np.triu_indices(6)
Shape = tuple[Floats, Ints, Floats, Bools]  # vertices, faces, vertex_sigma_m, vertex_observed

COLUMNS = {  # of an object: kind of numbers, shape
    "id": ("i", ()),
    "group": ("i", ()),
    "row": ("i", ()),
    "category": ("i", ()),
    "position": ("f", (3,)),
    "rotation": ("f", (3, 3)),
    "size": ("i", (3,)),
    "covariance": ("f", (21,)),
    "views": ("i", ()),
    "first_frame": ("i", ()),
    "last_frame": ("i", ()),
    "mask_iou": ("f", ()),
    "has_sigma": ("b", ()),
    "has_observed": ("b", ()),
    "keypoints": ("i", ()),
    "keypoint_row": ("i", ()),
}


def check_columns(table: Arrays) -> None:
    """ValueError for a table that is not one of ours."""
    for name in ("groups", "categories", "keypoint_texts", *COLUMNS):
        if name not in table:
            raise ValueError(f"{name} is missing")
        if name not in COLUMNS and (table[name].dtype.kind != "U" or table[name].ndim != 1):
            raise ValueError(f"{name} is {table[name].dtype} of shape {table[name].shape}, expected a list of texts")
    count = len(np.atleast_1d(table["id"]))
    for name, (kind, shape) in COLUMNS.items():
        if table[name].shape != (count, *shape) or table[name].dtype.kind != kind:
            raise ValueError(f"{name} is {table[name].dtype} of shape {table[name].shape}, expected {(count, *shape)}")
    if not np.isfinite(table["position"]).all() or (np.diff(table["id"]) <= 0).any():
        raise ValueError("positions are not finite, or ids not ascending")


def columns_of(things: Sequence[MapObject], categories: Mapping[str, Category]) -> Arrays:
    """What the table holds of each object."""
    names = sorted({thing.category for thing in things})
    kinds = [_keypoint_kind(thing, categories) for thing in things]
    own = [i for i, kind in enumerate(kinds) if kind == _OWN_KEYPOINTS]
    texts = [json.dumps({k: p.tolist() for k, p in sorted(things[i].keypoints.items())}) for i in own]
    rows = np.zeros(len(things), np.int32)
    rows[own] = np.arange(len(own))
    poses = [thing.world_from_object for thing in things]
    return {
        "id": np.array([thing.id for thing in things], np.int64),
        "categories": array_of_texts(names),
        "category": np.array([names.index(thing.category) for thing in things], np.int16),
        "position": np.array([pose.translation for pose in poses], float).reshape(-1, 3),
        "rotation": np.array([pose.rotation for pose in poses], float),
        "size": np.array([_size_in_steps(thing) for thing in things], np.int32).reshape(-1, 3),
        "covariance": np.array([_upper(thing.pose_covariance) for thing in things], np.float32).reshape(-1, 21),
        "views": np.array([thing.views for thing in things], np.int32),
        "first_frame": np.array([_or_none(thing.first_frame) for thing in things], np.int64),
        "last_frame": np.array([_or_none(thing.last_frame) for thing in things], np.int64),
        "mask_iou": np.array([np.nan if t.mask_iou is None else t.mask_iou for t in things], np.float32),
        "has_sigma": np.array([thing.vertex_sigma_m is not None for thing in things], bool),
        "has_observed": np.array([thing.vertex_observed is not None for thing in things], bool),
        "keypoints": np.array(kinds, np.int8),
        "keypoint_row": rows,
        "keypoint_texts": array_of_texts(texts),
    }


def _size_in_steps(thing: MapObject) -> Ints:
    """Length, width, height in whole steps: those of the rounded mesh, so that writing it again changes nothing."""
    steps = np.round(thing.vertices.astype(np.float32) / STEP_M)
    size: Ints = np.ptp(steps, axis=0).astype(np.int64)
    return size


def _keypoint_kind(thing: MapObject, categories: Mapping[str, Category]) -> int:
    if not thing.keypoints:
        return _NO_KEYPOINTS
    model = categories.get(thing.category)
    if (
        model is not None
        and set(thing.keypoints) == set(model.keypoint_names)
        and len(thing.vertices) == len(model.vertices)
    ):
        given = np.array([thing.keypoints[name] for name in model.keypoint_names])
        if np.abs(given - model.keypoints(thing.vertices)).max() < _KEYPOINT_TOLERANCE_M:
            return _KEYPOINTS_OF_MESH
    return _OWN_KEYPOINTS


def object_of(table: Arrays, index: int, shape: Shape, categories: Mapping[str, Category]) -> MapObject:
    """An object of the table, with its mesh."""
    row = {key: table[key][index] for key in COLUMNS}
    vertices, faces, sigma_m, observed = shape
    category = str(table["categories"][row["category"]])
    return MapObject(
        int(row["id"]),
        category,
        Pose(np.asarray(row["rotation"], float), np.asarray(row["position"], float)),
        vertices,
        faces,
        views=int(row["views"]),
        first_frame=_whole_or_none(row["first_frame"]),
        last_frame=_whole_or_none(row["last_frame"]),
        mask_iou=None if np.isnan(row["mask_iou"]) else float(row["mask_iou"]),
        keypoints=_keypoints(table, row, vertices, categories.get(category)),
        pose_covariance=_covariance(row["covariance"]),
        vertex_sigma_m=sigma_m if row["has_sigma"] else None,
        vertex_observed=observed if row["has_observed"] else None,
    )


def _keypoints(table: Arrays, row: Mapping[str, Any], vertices: Floats, model: Category | None) -> dict[str, Floats]:
    if row["keypoints"] == _OWN_KEYPOINTS:
        given = json.loads(str(table["keypoint_texts"][row["keypoint_row"]]))
        return {str(name): np.array(point, float) for name, point in given.items()}
    if row["keypoints"] == _NO_KEYPOINTS or model is None:
        return {}
    return dict(zip(model.keypoint_names, model.keypoints(vertices), strict=True))


def _upper(covariance: Floats | None) -> Floats:
    return np.full(21, np.nan) if covariance is None else np.asarray(covariance[_UPPER], float)


def _covariance(upper: Floats) -> Floats | None:
    if np.isnan(upper).all():
        return None
    covariance = np.zeros((6, 6))
    covariance[_UPPER] = upper
    whole: Floats = covariance + np.triu(covariance, 1).T
    return whole


def _or_none(frame: int | None) -> int:
    return -1 if frame is None else frame


def _whole_or_none(frame: Any) -> int | None:  # noqa: ANN401 # a NumPy number
    return None if frame < 0 else int(frame)


def array_of_texts(texts: Sequence[str]) -> Any:  # noqa: ANN401 # an array of texts
    """An array of texts."""
    return np.array(texts, dtype=f"<U{max([1, *map(len, texts)])}")
