"""Views as plain arrays, and back, to the last bit: masks as run lengths, distances as what they are measured from."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from meshslam.geometry import Bytes, Camera, Floats, Ints, ObjectModel, Pose, View
from meshslam.objects.observations import signed_distance
from meshslam.perception import decode_segmentation, encode_mask


def views_to_arrays(views: Sequence[View]) -> dict[str, Any]:
    """Views as `make_view` makes them, behind each other."""
    plain = [_pictures_to_plain(view) for view in views]
    borders, keypoints = [view.border() for view in views], [view.keypoints() for view in views]
    return {
        "pictures": np.frombuffer(json.dumps(plain).encode(), np.uint8),
        "surface_sigma_px": np.array([view.surface_sigma_px for view in views]),
        "border": np.concatenate([np.zeros((0, 4)), *borders]),
        "border_counts": np.array([len(border) for border in borders], np.int64),
        "keypoints": np.concatenate([np.zeros((0, 4)), *keypoints]),
        "keypoint_counts": np.array([len(points) for points in keypoints], np.int64),
    }


def views_from_arrays(arrays: Mapping[str, Any], model: ObjectModel, camera: Camera) -> Iterator[View]:
    """The reverse of `views_to_arrays`; GeometryError for a view that does not fit the model."""
    borders = _split(arrays["border"], arrays["border_counts"])
    keypoints = _split(arrays["keypoints"], arrays["keypoint_counts"])
    pictures, sigmas = json.loads(arrays["pictures"].tobytes()), arrays["surface_sigma_px"].tolist()
    for plain, border, points, sigma_px in zip(pictures, borders, keypoints, sigmas, strict=True):
        yield _view(plain, border, points, model, camera).with_surface_sigma(sigma_px)


def _split(rows: Floats, counts: Ints) -> list[Floats]:
    return np.split(rows, np.cumsum(counts)[:-1]) if len(counts) else []


def _pictures_to_plain(view: View) -> dict[str, Any]:
    distance_px, cut, hidden = view.pictures()
    masks = {"mask": distance_px < 0, "cut": cut, "hidden": hidden}
    packed = {name: encode_mask(np.asarray(mask, np.uint8))["counts"] for name, mask in masks.items()}
    return {"origin": list(view.origin), "size": list(distance_px.shape), **packed}


def _view(plain: dict[str, Any], border: Floats, keypoints: Floats, model: ObjectModel, camera: Camera) -> View:
    x, y = plain["origin"]
    return model.view(
        camera,
        Pose.identity(),
        origin=(x, y),
        distance_px=signed_distance(_mask(plain, "mask")),
        cut=_mask(plain, "cut") > 0,
        hidden=_mask(plain, "hidden") > 0,
        border=border[:, :2],
        border_length_px=border[:, 2],
        border_own=border[:, 3] > 0,
        keypoint_index=keypoints[:, 0].astype(np.int64),
        keypoint_pixels=keypoints[:, 1:3],
        keypoint_sigma_px=keypoints[:, 3],
    )


def _mask(plain: dict[str, Any], name: str) -> Bytes:
    height, width = plain["size"]
    return decode_segmentation({"size": [height, width], "counts": plain[name]}, height, width)
