"""One frame's detections against the map: which object each shows, what hides it, its view."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from meshslam.geometry import Camera, Pose, View, render
from meshslam.geometry.arrays import Bytes, Floats
from meshslam.localization.config import AssociationConfig
from meshslam.localization.known_objects import KnownObject
from meshslam.mapping.config import MappingConfig
from meshslam.mapping.observations import make_view
from meshslam.perception import Detection

_COARSE = 4  # the predicted view is drawn at a quarter of the resolution
_MARGIN_PX = 8.0  # boxes nearer than this touch


@dataclass
class FrameMasks:
    """A frame's detections with their masks unpacked once."""

    camera: Camera
    detections: tuple[Detection, ...]
    masks: dict[int, Bytes] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.masks = {d.id: d.mask() for d in self.detections}


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
    allowed = overlaps >= np.where(same_id, config.minimum_iou_same_id, config.minimum_iou)
    allowed &= np.array([[d.category == o.category for o in objects] for d in frame.detections])
    score = np.where(allowed, overlaps + config.id_bonus * same_id, 0.0)
    rows, columns = linear_sum_assignment(score, maximize=True)
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    return {frame.detections[i].id: objects[j] for i, j in pairs if score[i, j] > 0}


def in_view(
    camera: Camera, world_from_camera: Pose, objects: Sequence[KnownObject], largest_distance_m: float
) -> list[KnownObject]:
    """The objects that may be seen, by number."""
    eye = world_from_camera.translation
    near = [o for o in objects if float(np.linalg.norm(o.world_from_object.translation - eye)) < largest_distance_m]
    return [o for o in near if o.box(camera, world_from_camera) is not None]


def frame_views(
    frame: FrameMasks,
    world_from_camera: Pose,
    matched: Mapping[int, KnownObject],
    expected: Sequence[KnownObject],
    keypoint_names: Mapping[str, tuple[str, ...]],
    config: MappingConfig,
) -> dict[int, View]:
    """Views by detection id; `expected` are the objects that may be seen, matched or not."""
    depth = {o.id: float(world_from_camera.inverse().transform(o.world_from_object.translation)[2]) for o in expected}
    seen = {o.id for o in matched.values()}
    unseen = [o for o in expected if o.id not in seen]
    views = {}
    for detection in frame.detections:
        thing = matched.get(detection.id)
        if thing is None:
            continue
        occluder = np.zeros((frame.camera.height, frame.camera.width), np.uint8)
        for other in frame.detections:
            if other.id == detection.id or not touch(other.bbox, detection.bbox):
                continue
            blocker = matched.get(other.id)
            nearer = depth[blocker.id] < depth[thing.id] if blocker is not None else lowest(other) > lowest(detection)
            if nearer:
                occluder |= frame.masks[other.id]
        occluder |= _drawn_before(frame.camera, world_from_camera, thing, unseen, depth, detection)
        order = thing.keypoint_order(keypoint_names.get(detection.category, ()))
        views[detection.id] = make_view(
            thing.model, frame.camera, Pose.identity(), 0.0, detection, occluder, order, config
        )
    return views


def _drawn_before(
    camera: Camera,
    world_from_camera: Pose,
    thing: KnownObject,
    unseen: Sequence[KnownObject],
    depth: Mapping[int, float],
    detection: Detection,
) -> Bytes:
    """Mask (h, w) of nearer objects that no detection shows."""
    x, y, w, h = detection.bbox
    before = []
    for other in unseen:
        box = other.box(camera, world_from_camera) if depth[other.id] < depth[thing.id] else None
        if box is not None and touch((box[0], box[1], box[2] - box[0], box[3] - box[1]), (x, y, w, h)):
            before.append((world_from_camera.inverse() @ other.world_from_object, other.vertices, other.faces))
    if not before:
        return np.zeros((camera.height, camera.width), np.uint8)
    return render(camera, before).mask


Box = tuple[float, float, float, float]


def touch(one: Box, other: Box) -> bool:
    """Whether two boxes come near each other."""
    (ax, ay, aw, ah), (bx, by, bw, bh) = one, other
    return max(max(ax, bx) - min(ax + aw, bx + bw), max(ay, by) - min(ay + ah, by + bh)) < _MARGIN_PX


def lowest(detection: Detection) -> tuple[float, float]:
    """Order of nearness on the ground: the lowest row, then the size."""
    return round(detection.bbox[1] + detection.bbox[3], 1), detection.bbox[2] * detection.bbox[3]
