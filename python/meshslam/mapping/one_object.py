"""One object from its masks alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from meshslam.categories import Category, load_category
from meshslam.errors import MapError
from meshslam.geometry import Bytes, Camera, Pose
from meshslam.mapping.config import MappingConfig
from meshslam.mapping.pipeline import map_objects
from meshslam.maps import CameraPath, MapObject
from meshslam.objects import ObjectConfig
from meshslam.perception import CategoryEntry, Detection, DetectionSet, ImageEntry

_INTERVAL_S = 0.1  # between views: the object is parked, so that times say nothing


def object_from_masks(
    masks: Sequence[Bytes],
    world_from_camera: Sequence[Pose],
    camera: Camera,
    category: Category | str = "car",
    config: ObjectConfig | None = None,
) -> MapObject:
    """The mesh and the pose of one object from its masks and the poses of the camera; no network is used.

    Each mask (h, w) is of a whole image, set above 0 where the object is seen; empty ones are passed over. There is one
    pose for each mask. The world's z axis is up, and the object stands upright. Without key points its front and rear
    are told apart by its shape alone. MapError says why no object fits, or that masks and poses do not go together.

    Example:
        car = object_from_masks(masks, world_from_camera, camera)
        car.vertices, car.vertex_sigma_m  # (V, 3) in the object's frame, (V,), metres

    """
    known = load_category(category) if isinstance(category, str) else category
    frames, size = range(len(masks)), (camera.height, camera.width)
    if len(masks) != len(world_from_camera):
        raise MapError(f"there is one pose for each mask, found {len(masks)} masks and {len(world_from_camera)} poses")
    for k, mask in enumerate(masks):
        if np.shape(mask) != size:
            raise MapError(f"mask {k} has shape {np.shape(mask)}, expected the camera's (h, w) = {size}")
    seen = tuple(
        Detection.from_mask(mask, id=k + 1, frame=k, category=known.name, track_id=1)
        for k, mask in enumerate(masks)
        if np.any(mask)
    )
    images = tuple(ImageEntry(k, f"{k:06d}.png", camera.width, camera.height) for k in frames)
    found = DetectionSet(images, (CategoryEntry(1, known.name),), seen)
    times_s = np.arange(len(masks)) * np.float64(_INTERVAL_S)
    path = CameraPath(camera, tuple(frames), times_s, tuple(world_from_camera), None)
    alone = MappingConfig(use_ground=False, min_views=1)
    mapped = map_objects(path, found, known, config or ObjectConfig(), alone, fixed_tracks=True)
    if not len(mapped.map):
        why = "; ".join(f"{left.reason} ({left.detail})" for left in mapped.left_out)
        raise MapError(f"no {known.name} fits the masks: {why or 'every mask is empty'}")
    return mapped.map.objects[0]
