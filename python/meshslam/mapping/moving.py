"""Tracks that were left out because they move: those that drive become moving objects of the map."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from meshslam.mapping.config import MappingConfig
from meshslam.mapping.finished import Finished
from meshslam.mapping.left_out import LeftOut
from meshslam.mapping.work import Progress, each, first_pass
from meshslam.maps import MovingObject
from meshslam.moving import Estimated, ShapePrior, estimate_moving
from meshslam.objects import Occluders, Scene, Track

MOVES = "moves"
DOUBTED = ("too far", "not on the road", "no such shape", "does not fit its masks")  # may be as it moves


def moving_objects(
    left_out: Iterable[LeftOut],
    tracks: Iterable[Track],
    standing: Iterable[Finished],
    scene: Scene,
    occluders: Occluders,
    config: MappingConfig,
    progress: Progress | None = None,
) -> tuple[tuple[MovingObject, ...], list[LeftOut]]:
    """Objects of the tracks that were left out because they move, or may do so, and what is left out still.

    What stands tells what shapes the drive's objects have.
    """
    reasons = list(left_out)
    tried = (MOVES, *DOUBTED) if config.moving.enabled else ()
    moved = {row.track for row in reasons if row.reason in tried}
    chosen = [track for track in tracks if track.id in moved]

    shapes = ShapePrior.of_drive(
        [one.shape for one in standing if one.unfit is None and one.shape is not None], scene.model.mode_count
    )

    def estimate(track: Track) -> Estimated:
        first = first_pass(track, scene, occluders)
        given = (track, first.found.state, first.observed, scene, occluders)
        return estimate_moving(*given, config.moving, shapes, config.min_mask_iou)

    found = dict(zip([t.id for t in chosen], each("moving", estimate, chosen, progress), strict=True))
    objects = tuple(one.object for one in found.values() if one.object is not None)
    mapped = {thing.id for thing in objects}
    rest = [
        row if row.track not in found else _doubted(row, found[row.track]) for row in reasons if row.track not in mapped
    ]
    return objects, rest


def _doubted(row: LeftOut, found: Estimated) -> LeftOut:
    return replace(row, detail=f"{row.detail}; {found.doubt}") if row.reason == MOVES else row
