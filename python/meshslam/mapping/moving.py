"""Tracks that may show objects that drive: those that do become moving objects of the map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from meshslam.mapping.config import MappingConfig
from meshslam.mapping.finished import Finished
from meshslam.mapping.left_out import LeftOut
from meshslam.mapping.work import Progress, each, first_pass
from meshslam.maps import MovingObject
from meshslam.moving import (
    Begun,
    Estimated,
    MovingConfig,
    PathBounds,
    ShapeEvidence,
    ShapePrior,
    begin_moving,
    finish_moving,
)
from meshslam.objects import Occluders, Scene, Track

MOVES = "moves"
DOUBTED = ("too far", "not on the road", "no such shape", "does not fit its masks")  # may be as it moves


@dataclass(frozen=True, eq=False)
class MovingMapping:
    """What drives, and which tracks do not after all."""

    objects: tuple[MovingObject, ...]
    left_out: tuple[LeftOut, ...]  # what is left out still, with the reason


def map_moving(
    left_out: Sequence[LeftOut],
    tracks: Sequence[Track],
    standing: Sequence[Finished],
    scene: Scene,
    occluders: Occluders,
    config: MappingConfig,
    progress: Progress | None = None,
) -> MovingMapping:
    """Paths of tracks that were left out and may move, and of those in the map that the motion test doubts.

    Each is fitted twice: then all objects of the drive but itself tell what shapes there are. Those in the map come
    first: one that stands after all tells its shape as what stands does.
    """
    stands = [one for one in standing if one.unfit is None]
    chosen = _to_try(left_out, tracks, stands, config) if config.moving.enabled else []
    modes, settings = scene.model.mode_count, config.moving
    needed = {one.work.observed.track.id: _in_its_place(one, config) for one in stands}
    otherwise = PathBounds(settings.min_gain, config.min_mask_iou)
    of_standing = {one.work.observed.track.id: one.shape for one in stands}
    shapes: dict[int, ShapeEvidence | None] = dict(of_standing)

    def told_by_others(track: Track) -> ShapePrior:
        return ShapePrior.of_drive(_known({n: shape for n, shape in shapes.items() if n != track.id}), modes)

    def begin(track: Track) -> Begun:
        fit = first_pass(track, scene, occluders)
        prior = told_by_others(track)
        return begin_moving(track, fit.found.state, fit.observed, scene, occluders, settings, prior)

    def finish(begun: Begun) -> Estimated:
        enough = needed.get(begun.track.id, otherwise)
        return finish_moving(begun, scene, occluders, settings, told_by_others(begun.track), enough)

    begun = each("paths", begin, chosen, progress)
    shapes |= {one.track.id: one.shape for one in begun}
    doubted = [one for one in begun if one.track.id in of_standing]
    told = dict(zip([one.track.id for one in doubted], each("doubted", finish, doubted, progress), strict=True))
    shapes |= {number: of_standing[number] for number, one in told.items() if one.object is None}
    others = [one for one in begun if one.track.id not in of_standing]
    ended = told | dict(zip([one.track.id for one in others], each("moving", finish, others, progress), strict=True))
    objects = tuple(one.object for one in ended.values() if one.object is not None)
    mapped = {thing.id for thing in objects}
    return MovingMapping(objects, tuple(_told(row, ended) for row in left_out if row.track not in mapped))


def _to_try(
    left_out: Sequence[LeftOut], tracks: Sequence[Track], stands: Sequence[Finished], config: MappingConfig
) -> list[Track]:
    """Tracks that may show an object that drives.

    One that stops and goes, or goes ahead of the camera, looks much like a larger one that stands further away: the
    motion test's one velocity gains little there, a path much.
    """
    numbers = {row.track for row in left_out if row.reason in (MOVES, *DOUBTED)}
    numbers |= {one.work.observed.track.id for one in stands if _is_doubtful(one, config.moving)}
    return [track for track in tracks if track.id in numbers]


def _in_its_place(one: Finished, config: MappingConfig) -> PathBounds:
    """What a path must reach to take an object's place that stands: its masks are explained well, or far better."""
    settings, overlap = config.moving, 0.0 if one.object is None else one.object.mask_iou or 0.0
    enough = min(settings.standing_mask_iou, overlap + settings.standing_mask_iou_step)
    return PathBounds(settings.standing_gain, max(config.min_mask_iou, enough))


def _is_doubtful(one: Finished, config: MovingConfig) -> bool:
    """Whether an object in one place does not explain its masks well enough not to ask for a path."""
    overlap = None if one.object is None else one.object.mask_iou
    return one.motion_gain > config.doubt_gain or (overlap is not None and overlap < config.doubt_mask_iou)


def _known(shapes: dict[int, ShapeEvidence | None]) -> list[ShapeEvidence]:
    return [shape for _, shape in sorted(shapes.items()) if shape is not None]


def _told(row: LeftOut, ended: dict[int, Estimated]) -> LeftOut:
    """The reason, and for what moves why it has no path."""
    doubt = ended[row.track].doubt if row.reason == MOVES and row.track in ended else ""
    return replace(row, detail=f"{row.detail}; {doubt}") if doubt else row
