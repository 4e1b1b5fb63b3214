"""RF-DETR's instance segmentation (Roboflow, 1.11): boxes, class logits and masks of a fixed number of queries."""

from __future__ import annotations

from collections.abc import Sequence

from meshslam.perception.network_output import Part, Table
from meshslam.perception.network_session import Output

NUMBERED = 91  # classes by COCO's numbers, of which 0 and ten more are none


def recognize_rf_detr(outputs: Sequence[Output]) -> Table | None:
    """The layout of `dets` (1, Q, 4), `labels` (1, Q, C) and `masks` (1, Q, h, w); None for others."""
    dims = {o.name: o.dims for o in outputs}
    if set(dims) != {"dets", "labels", "masks"}:
        return None
    if [len(dims[name]) for name in ("dets", "labels", "masks")] != [3, 3, 4] or dims["dets"][2] not in (4, None):
        return None
    return Table(
        name="RF-DETR",
        boxes=Part("dets"),
        box_format="cxcywh",
        normalised=True,
        scores=Part("labels"),
        score_kind="logits",
        masks=Part("masks"),
    )
