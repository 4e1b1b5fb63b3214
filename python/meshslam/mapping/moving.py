"""Tracks that were left out because they move: those that drive become moving objects of the map."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from meshslam.mapping.config import MappingConfig
from meshslam.mapping.left_out import LeftOut
from meshslam.mapping.work import Progress, each, first_pass
from meshslam.maps import MovingObject
from meshslam.moving import Estimated, estimate_moving
from meshslam.objects import Occluders, Scene, Track

MOVES = "moves"


def moving_objects(
    left_out: Iterable[LeftOut],
    tracks: Iterable[Track],
    scene: Scene,
    occluders: Occluders,
    config: MappingConfig,
    progress: Progress | None = None,
) -> tuple[tuple[MovingObject, ...], list[LeftOut]]:
    """Objects of the tracks that were left out because they move, and what is left out still, with the reason."""
    reasons = list(left_out)
    moved = {row.track for row in reasons if row.reason == MOVES} if config.moving.enabled else set()
    chosen = [track for track in tracks if track.id in moved]

    def estimate(track: Track) -> Estimated:
        standing = first_pass(track, scene, occluders)
        state = standing.found.state
        return estimate_moving(track, state, standing.observed, scene, occluders, config.moving, config.min_mask_iou)

    found = dict(zip([t.id for t in chosen], each("moving", estimate, chosen, progress), strict=True))
    objects = tuple(one.object for one in found.values() if one.object is not None)
    mapped = {thing.id for thing in objects}
    rest = [
        row if row.track not in found else _doubted(row, found[row.track]) for row in reasons if row.track not in mapped
    ]
    return objects, rest


def _doubted(row: LeftOut, found: Estimated) -> LeftOut:
    return replace(row, detail=f"{row.detail}; {found.doubt}")
