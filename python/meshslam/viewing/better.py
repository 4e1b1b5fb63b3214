"""Which way a figure is better, by its key."""

from __future__ import annotations

import re
from typing import Literal

Better = Literal["lower", "higher"] | None
_HIGHER = re.compile(
    r"^(recall|mask_iou\w*|mask_share_mapped|voxel_iou\w*|f_score\w*|a3dp_\w+|kitti_ap_\w+|mota|idf1|hota\w*)$"
)
_LOWER = re.compile(
    r"^(ate_\w+|rpe_\w+|kitti_[tr]_rel_\w+|end_error_\w+|centre_error_\w+|yaw_error_\w+|chamfer_\w+|objects_extra"
    r"|objects_reversed|mota_\w+|seconds_\w+|milliseconds_\w+|peak_memory_mb|position_error_\w+|frames_without_objects"
    r"|live_poses_late\w*)$"
)
_NEITHER = re.compile(r"^(ate_sim3_scale|voxel_iou_category_model|mask_iou_(single_frame|category_model|pose))$")


def better_of(key: str) -> Better:
    """`lower`, `higher`, or None where neither is better: counts, the scale, shares inside a region, NEES.

    >>> better_of("ate_rmse_m"), better_of("recall"), better_of("frames")
    ('lower', 'higher', None)
    """
    if _NEITHER.match(key):
        return None
    return "higher" if _HIGHER.match(key) else "lower" if _LOWER.match(key) else None
