"""One frame's detections against the map: which object each shows, what hides it, its observation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from meshslam.categories import keypoint_order
from meshslam.geometry import Bytes, Camera, Floats, Pose, View, best_pairs, render
from meshslam.localization.config import AssociationConfig
from meshslam.localization.map_models import KnownObject
from meshslam.objects import FrameOcclusion, ObjectConfig, make_view
from meshslam.perception import Detection

_COARSE = 4  # predicted masks are drawn at a quarter of the resolution


@dataclass
class FrameMasks:
    """A frame's detections with their masks unpacked once."""

    camera: Camera
    detections: tuple[Detection, ...]
    masks: dict[int, Bytes] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.masks = {d.id: d.mask() for d in self.detections}

    def mask(self, detection: Detection) -> Bytes:
        """A detection's mask (h, w)."""
        return self.masks[detection.id]


def coarse_camera(camera: Camera) -> Camera:
    """The camera whose pixel i is pixel 4 i + 2."""
    half = _COARSE // 2
    return replace(
        camera,
        width=max(1, (camera.width - half + _COARSE - 1) // _COARSE),
        height=max(1, (camera.height - half + _COARSE - 1) // _COARSE),
        fx=camera.fx / _COARSE,
        fy=camera.fy / _COARSE,
        cx=(camera.cx - half) / _COARSE,
        cy=(camera.cy - half) / _COARSE,
        skew=camera.skew / _COARSE,
    )


def predicted_overlaps(frame: FrameMasks, world_from_camera: Pose, objects: Sequence[KnownObject]) -> Floats:
    """IoU (detections, objects) of each mask with the part of each object's hull that nearer ones leave visible."""
    half = _COARSE // 2
    coarse = coarse_camera(frame.camera)
    camera_from_world = world_from_camera.inverse()
    meshes = [(camera_from_world @ o.world_from_object, *o.hull) for o in objects]
    drawn = render(coarse, meshes).object_index
    sizes = np.bincount(drawn[drawn >= 0], minlength=len(objects))
    overlaps = np.zeros((len(frame.detections), len(objects)))
    for i, detection in enumerate(frame.detections):
        mask = frame.masks[detection.id][half::_COARSE, half::_COARSE] > 0
        under = drawn[mask]
        both = np.bincount(under[under >= 0], minlength=len(objects))
        overlaps[i] = both / np.maximum(int(mask.sum()) + sizes - both, 1)
    return overlaps


def associate(
    frame: FrameMasks, world_from_camera: Pose, objects: Sequence[KnownObject], config: AssociationConfig
) -> dict[int, KnownObject]:
    """Objects by detection id: one to one, the largest overlaps with the predicted view (Hungarian method).

    A track id that is an object's id is a hint: it adds to the overlap, and lowers what is asked of it.
    """
    if not frame.detections or not objects:
        return {}
    overlaps = predicted_overlaps(frame, world_from_camera, objects)
    same_id = np.array([[d.track_id == o.id for o in objects] for d in frame.detections])
    allowed = overlaps >= np.where(same_id, config.min_iou_same_id, config.min_iou)
    allowed &= np.array([[d.category == o.category for o in objects] for d in frame.detections])
    score = np.where(allowed, overlaps + config.id_bonus * same_id, 0.0)
    return {frame.detections[i].id: objects[j] for i, j in best_pairs(score) if score[i, j] > 0}


def in_view(
    camera: Camera, world_from_camera: Pose, objects: Sequence[KnownObject], max_distance_m: float
) -> list[KnownObject]:
    """The objects that may be seen, by number."""
    eye = world_from_camera.translation
    near = [o for o in objects if float(np.linalg.norm(o.world_from_object.translation - eye)) < max_distance_m]
    return [o for o in near if o.box(camera, world_from_camera) is not None]


def observations_of(
    frame: FrameMasks,
    world_from_camera: Pose,
    matched: Mapping[int, KnownObject],
    expected: Sequence[KnownObject],
    keypoint_names: Mapping[str, tuple[str, ...]],
    config: ObjectConfig,
) -> dict[int, View]:
    """Observations by detection id; `expected` are the objects that may be seen, matched or not."""
    camera_from_world = world_from_camera.inverse()
    poses = {o.id: camera_from_world @ o.world_from_object for o in expected}
    depths = {k: float(poses[o.id].translation[2]) for k, o in matched.items()}
    shown = {o.id for o in matched.values()}
    undetected = [(poses[o.id], o.vertices, o.faces) for o in expected if o.id not in shown]
    hidden = FrameOcclusion(frame.camera, frame.detections, frame.mask, depths, undetected)
    observations = {}
    for detection in frame.detections:
        thing = matched.get(detection.id)
        if thing is None:
            continue
        order = keypoint_order(keypoint_names.get(detection.category, ()), thing.keypoint_names)
        observations[detection.id] = make_view(
            thing.model, frame.camera, Pose.identity(), 0.0, detection, hidden.occluder(detection), order, config
        )
    return observations
