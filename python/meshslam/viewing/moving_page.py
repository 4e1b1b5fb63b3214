"""What drives, as data and as a table of the report."""

from __future__ import annotations

from typing import Any

import numpy as np

from meshslam.geometry import Floats
from meshslam.maps import MovingObject, object_colour
from meshslam.viewing.context import ReportContext
from meshslam.viewing.from_above import hull
from meshslam.viewing.markup import number, packed, size_m, table, text


def moving_data(context: ReportContext, origin: Floats) -> list[dict[str, Any]]:
    """One entry an object: poses (n, 12) relative to `origin` at frame numbers, its footprint in object, speeds."""
    return [_entry(one, origin) for one in context.map.moving]


def _entry(one: MovingObject, origin: Floats) -> dict[str, Any]:
    path = one.path
    rows = [np.column_stack([p.rotation, p.translation - origin]).ravel() for p in path.world_from_object]
    return {
        "id": one.id,
        "category": one.category,
        "colour": [int(c) for c in object_colour(one.id)],
        "frames": list(path.frame_ids),
        "poses": packed(np.array(rows, np.float32)),
        "footprint": np.round(hull(one.vertices[:, :2]), 3).tolist(),
        "length": round(float(one.body.dimensions[0]), 3),
        "speeds": np.round(path.speeds_m_s, 2).tolist(),
        "sigmas": np.round(path.position_sigmas_m, 3).tolist(),
    }


def moving_table(context: ReportContext) -> str:
    """One row an object that drives; empty if none does."""
    rows = [_row(one) for one in context.map.moving]
    if not rows:
        return ""
    headings = ["id", "category", "length &times; width &times; height", "frames", "way", "speed", "mask IoU"]
    headings += ['<abbr title="median standard deviations of speed and position">&sigma;</abbr>']
    return table(headings, rows, "moving")


def _row(one: MovingObject) -> list[str]:
    path, speeds = one.path, np.abs(one.path.speeds_m_s)
    way = float(np.linalg.norm(np.diff(path.positions_in_world, axis=0), axis=1).sum())
    speed_sigma, sigma = np.median(path.speed_sigmas_m_s), np.median(path.position_sigmas_m)
    return [
        str(one.id),
        text(one.category),
        f"{size_m(one.body.dimensions)}<small> m</small>",
        f"{path.frame_ids[0]}&ndash;{path.frame_ids[-1]}",
        f"{way:.1f}<small> m</small>",
        f"{speeds.min():.1f}&ndash;{speeds.max():.1f}<small> m/s</small>",
        number(one.body.mask_iou, 3),
        f"{speed_sigma:.2f}<small> m/s</small>, {sigma:.2f}<small> m</small>",
    ]
