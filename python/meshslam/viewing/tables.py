"""Figures, objects and what was left out, as HTML tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from meshslam.maps import MapObject, object_colour
from meshslam.viewing.context import ReportContext
from meshslam.viewing.from_above import position_covariance
from meshslam.viewing.markup import UNKNOWN, number, rgb, size_m, table, text


class Figure(NamedTuple):
    """How a figure of metrics.json is shown."""

    group: str
    label: str
    unit: str
    decimals: int


RUN, MASKS, TRUTH, COST, OTHER = "Run", "Mask IoU", "Against truth", "Time and memory", "Other"
FIGURES: dict[str, Figure] = {
    "frames": Figure(RUN, "frames", "", 0),
    "tracks": Figure(RUN, "tracks", "", 0),
    "objects_mapped": Figure(RUN, "objects mapped", "", 0),
    "objects_in_map": Figure(RUN, "objects in the map", "", 0),
    "objects_seen": Figure(RUN, "objects seen", "", 0),
    "objects_moved": Figure(RUN, "objects that were moved", "", 0),
    "views_used": Figure(RUN, "views used", "", 0),
    "views_refused": Figure(RUN, "views refused", "", 0),
    "frames_without_objects": Figure(RUN, "frames without objects", "", 0),
    "frames_with_imu_gap": Figure(RUN, "frames with a gap in the IMU", "", 0),
    "objects_in_graph": Figure(RUN, "objects in the graph", "", 0),
    "loop_closures": Figure(RUN, "loop closures", "", 0),
    "tracks_moving": Figure(RUN, "tracks that move", "", 0),
    "scale_by_imu": Figure(RUN, "scale: by the IMU (1 or 0)", "", 0),
    "scale_by_odometry": Figure(RUN, "scale: by odometry (1 or 0)", "", 0),
    "scale_by_objects": Figure(RUN, "scale: objects' sizes", "", 0),
    "scale_by_road_displacements": Figure(RUN, "scale: displacements by road and camera height", "", 0),
    "imu_time_offset_s": Figure(RUN, "IMU clock ahead by", "s", 4),
    "imu_from_camera_change_deg": Figure(RUN, "extrinsics turned by", "°", 2),
    "mask_iou_single_frame": Figure(MASKS, "single frame", "", 3),
    "mask_iou_category_model": Figure(MASKS, "category model", "", 3),
    "mask_iou_pose": Figure(MASKS, "after pose", "", 3),
    "mask_iou_shape": Figure(MASKS, "after shape", "", 3),
    "voxel_iou_category_model": Figure(TRUTH, "voxel IoU, category model", "", 3),
    "voxel_iou_mean": Figure(TRUTH, "voxel IoU, instances", "", 3),
    "centre_error_median_m": Figure(TRUTH, "centre error, median", "m", 3),
    "yaw_error_median_deg": Figure(TRUTH, "yaw error, median", "°", 2),
    "recall": Figure(TRUTH, "recall", "", 3),
    "ate_rmse_m": Figure(TRUTH, "path error, RMSE", "m", 3),
    "ate_initial_rmse_m": Figure(TRUTH, "path error, inertial only", "m", 3),
    "ate_filtered_rmse_m": Figure(TRUTH, "path error, before smoothing", "m", 3),
    "end_error_percent": Figure(TRUTH, "end error", "%", 2),
    "seconds_total": Figure(COST, "total", "s", 1),
    "seconds_perception": Figure(COST, "perception", "s", 1),
    "seconds_tracking": Figure(COST, "tracking", "s", 1),
    "seconds_mapping": Figure(COST, "mapping", "s", 1),
    "seconds_localization": Figure(COST, "localization", "s", 1),
    "seconds_imports": Figure(COST, "start and imports", "s", 1),
    "position_sigma_mean_m": Figure(RUN, "sigma of a position, mean", "m", 3),
    "rotation_sigma_mean_deg": Figure(RUN, "sigma of a rotation, mean", "°", 3),
    "seconds_report": Figure(COST, "report", "s", 1),
    "milliseconds_per_frame": Figure(COST, "per frame", "ms", 0),
    "peak_memory_mb": Figure(COST, "peak memory", "MB", 0),
}
UNITS = {"m": "m", "deg": "°", "percent": "%", "mb": "MB", "px": "px", "s": "s"}


def describe(key: str) -> Figure:
    """How to show a figure; one that is not known by its name, with the unit at its end."""
    if key in FIGURES:
        return FIGURES[key]
    stem, _, end = key.rpartition("_")
    label = (stem if stem and end in UNITS else key).replace("_", " ")
    return Figure(OTHER, label, UNITS.get(end, "") if stem else "", 3)


def figures_table(metrics: Mapping[str, float]) -> str:
    """All figures, in groups."""
    order = {key: i for i, key in enumerate(FIGURES)}
    groups: dict[str, list[str]] = {group: [] for group in (RUN, MASKS, TRUTH, COST, OTHER)}
    for key in sorted(metrics, key=lambda k: (order.get(k, len(order)), k)):
        shown = describe(key)
        value = f"{number(metrics[key], shown.decimals)}<small> {shown.unit}</small>"
        groups[shown.group].append(
            f"<tr title='{text(key)}'><th scope=row>{text(shown.label)}</th><td>{value}</td></tr>"
        )
    tables = [f"<table><caption>{g}</caption>{''.join(rows)}</table>" for g, rows in groups.items() if rows]
    return f"<div class=figures>{''.join(tables)}</div>" if tables else ""


def objects_table(context: ReportContext) -> str:
    """One row an object."""
    headings = ["id", "category", "length &times; width &times; height", "views", "frames", "mask IoU"]
    explained = {
        "position, 1 &sigma;": "standard deviation along the least certain axis",
        "surface seen": "share of the vertices that some view shows; the rest is the category's prior",
        "yaw": "heading about z in world",
    }
    headings += [f'<abbr title="{why}">{name}</abbr>' for name, why in explained.items()]
    rows = [_object_row(thing) for thing in context.map.objects]
    return table(headings, rows, "objects") if rows else "<p class=none>No object is in the map.</p>"


def _object_row(thing: MapObject) -> list[str]:
    colour = rgb(object_colour(thing.id))
    chip = f'<button type=button class=chip data-id="{thing.id}"><i style="background:{colour}"></i>{thing.id}</button>'
    size = f"{size_m(thing.dimensions)}<small> m</small>"
    frames = UNKNOWN if thing.first_frame is None else f"{thing.first_frame}&ndash;{thing.last_frame}"
    sigma = position_sigma_m(thing)
    seen = None if thing.vertex_observed is None else 100 * float(np.mean(thing.vertex_observed))
    return [
        chip,
        text(thing.category),
        size,
        str(thing.views),
        frames,
        number(thing.mask_iou, 3),
        _with_unit(None if sigma is None else 100 * sigma, 1, "cm"),
        _with_unit(seen, 0, "%"),
        _with_unit(float(np.degrees(thing.world_from_object.yaw_rad)), 1, "°"),
    ]


def position_sigma_m(thing: MapObject) -> float | None:
    """Standard deviation of an object's position along its least certain axis, metres."""
    covariance = position_covariance(thing)
    return None if covariance is None else float(np.sqrt(max(np.linalg.eigvalsh(covariance).max(), 0.0)))


def _with_unit(value: float | None, decimals: int, unit: str) -> str:
    return number(value, decimals) + ("" if value is None else f"<small> {unit}</small>")


def left_out_table(context: ReportContext) -> str:
    """Tracks that are no objects, with the reason; empty if there are none."""
    rows = [[str(track), text(reason), text(detail)] for track, reason, detail in context.left_out]
    return table(["track", "reason", "found"], rows, "left") if rows else ""
