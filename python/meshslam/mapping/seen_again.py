"""Tracks that show a car of the map again: too short, small or far to tell its place, they lie where it is drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from meshslam.geometry import Bools, Camera, Floats, Pose, render
from meshslam.mapping.left_out import LeftOut
from meshslam.maps import CameraPath, MapObject
from meshslam.perception import Detection, DetectionSet, voted_category

_MOST_LOOKED_AT = 8  # detections of a track
_LEAST_IOU = 0.5  # of a mask with the drawn car, mean over them
_CLEARER = 0.15  # by which the second best must be worse
_SAME_PLACE = 11.3  # squared Mahalanobis distance: 99% of a normal distribution in space
_REACH_M = 120.0  # objects further away are not drawn
_NOT_PARKED = frozenset({"moves", "other category"})


def seen_again(
    objects: Sequence[MapObject],
    detections: DetectionSet,
    left_out: Sequence[LeftOut],
    frames: CameraPath,
    *,
    only: frozenset[int] | None = None,
) -> tuple[DetectionSet, list[LeftOut]]:
    """Put tracks without an object onto the objects of the map that they show; what is left out says so.

    `only`: the objects that come into question, by id; all others are drawn as what may stand before them.
    """
    tracks, poses = detections.by_track(), frames.pose_of_frame()
    taken = {thing.id: {d.frame for d in tracks.get(thing.id, ())} for thing in objects}
    reasons = {row.track: row for row in left_out}
    moved: dict[int, int | None] = {}
    for number, row in reasons.items():
        found = [d for d in tracks.get(number, ()) if d.frame in poses]
        if row.reason in _NOT_PARKED or not found or number in taken:
            continue
        seen, category = {d.frame for d in found}, voted_category(found)
        asked = [o for o in objects if o.category == category and (only is None or o.id in only)]
        free = [o for o in asked if not taken[o.id] & seen]
        best = _shown(free, objects, found, poses, frames.camera)
        if best is not None:
            taken[best] |= seen
            moved |= {d.id: best for d in tracks[number]}
            reasons[number] = LeftOut(number, "the same object", f"shows track {best} again")
    return (detections.with_tracks(moved) if moved else detections), [reasons.get(r.track, r) for r in left_out]


def same_place(
    objects: Sequence[MapObject], detections: DetectionSet, frames: CameraPath
) -> tuple[DetectionSet, dict[int, LeftOut]]:
    """Objects that are another one seen again, the least seen first: their place may be that one's.

    They are told by their ids; their detections go to the other one.
    """
    kept, gone = list(objects), dict[int, LeftOut]()
    for thing in sorted(objects, key=lambda o: (o.views, o.id)):
        others = [o for o in kept if o is not thing and _may_be(thing, o)]
        if others:
            alone = [LeftOut(thing.id, "")]
            rest = [o for o in kept if o is not thing]
            detections, [row] = seen_again(rest, detections, alone, frames, only=frozenset(o.id for o in others))
            if row.reason:
                gone[thing.id], kept = row, rest
    return detections, gone


def _may_be(thing: MapObject, other: MapObject) -> bool:
    """Whether another object of the category stands within an object's uncertainty."""
    if thing.category != other.category or thing.pose_covariance is None or other.pose_covariance is None:
        return False
    covariance = sum(
        o.world_from_object.rotation @ o.pose_covariance[:3, :3] @ o.world_from_object.rotation.T
        for o in (thing, other)
        if o.pose_covariance is not None
    )
    apart = other.world_from_object.translation - thing.world_from_object.translation
    return bool(apart @ np.linalg.solve(covariance, apart) < _SAME_PLACE)


def _shown(
    free: Sequence[MapObject],
    objects: Sequence[MapObject],
    found: Sequence[Detection],
    poses: Mapping[int, Pose],
    camera: Camera,
) -> int | None:
    """The object that a track's masks agree with, if one clearly does."""
    if not free:
        return None
    chosen = np.unique(np.linspace(0, len(found) - 1, min(len(found), _MOST_LOOKED_AT)).round().astype(int))
    ious = np.mean([_ious(free, objects, found[i], poses[found[i].frame], camera) for i in chosen], axis=0)
    order = np.argsort(-ious, kind="stable")
    second = float(ious[order[1]]) if len(order) > 1 else 0.0
    clear = ious[order[0]] >= max(_LEAST_IOU, second + _CLEARER)
    return free[int(order[0])].id if clear else None


def _ious(
    free: Sequence[MapObject], objects: Sequence[MapObject], seen: Detection, world_from_camera: Pose, camera: Camera
) -> Floats:
    """IoU of a mask with what each free object shows among all objects, those before others hiding them."""
    camera_from_world = world_from_camera.inverse()
    near = [o for o in objects if 0 < _depth_m(o, camera_from_world) < _REACH_M]
    drawn = render(camera, [(camera_from_world @ o.world_from_object, o.vertices, o.faces) for o in near]).object_index
    mask = seen.mask() > 0
    at = {o.id: i for i, o in enumerate(near)}
    return np.array([_iou(mask, drawn == at[o.id]) if o.id in at else 0.0 for o in free])


def _depth_m(thing: MapObject, camera_from_world: Pose) -> float:
    return float(camera_from_world.transform(thing.world_from_object.translation[None])[0, 2])


def _iou(one: Bools, other: Bools) -> float:
    return float((one & other).sum() / max(1, (one | other).sum()))
