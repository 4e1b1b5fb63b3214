"""KITTI's average precision of boxes from above (BEV) and in space, with 40 recall points."""

from __future__ import annotations

from collections.abc import Sequence

from meshslam.evaluation.average_precision import KITTI_RECALLS, average_precision, judge
from meshslam.evaluation.boxes import GroundBox, box_ious
from meshslam.evaluation.seen import SeenFrame, Sight

LEAST_HEIGHT_PX = 25.0  # of an image's box: KITTI's moderate and hard
OVERLAPS = (0.7, 0.5)  # KITTI's for cars, and the looser one that papers on one camera add


def kitti_detection_figures(frames: Sequence[SeenFrame]) -> dict[str, float]:
    """`kitti_ap_bev_70_percent`, `kitti_ap_3d_70_percent`, and both at an overlap of 0.5."""
    ious = {
        (f, e, t): box_ious(_box(estimate), _box(true))
        for f, seen in enumerate(frames)
        for e, estimate in enumerate(seen.estimates)
        for t, true in enumerate(seen.truths)
    }
    rows = [
        (
            [e.score for e in f.estimates],
            [e.height_px >= LEAST_HEIGHT_PX for e in f.estimates],
            [t.counts and t.height_px >= LEAST_HEIGHT_PX for t in f.truths],
        )
        for f in frames
    ]
    figures = {}
    for least in OVERLAPS:
        for place, name in enumerate(("bev", "3d")):

            def quality(frame: int, answer: int, truth: int, place: int = place, least: float = least) -> float | None:
                iou = ious[frame, answer, truth][place]
                return iou if iou >= least else None

            found = average_precision(judge(rows, quality), KITTI_RECALLS)
            figures[f"kitti_ap_{name}_{100 * least:.0f}_percent"] = 100 * found
    return figures


def _box(sight: Sight) -> GroundBox:
    return GroundBox.of(sight.world_from_object, sight.thing.dimensions)
