"""Figures, objects and what was left out, as HTML tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from meshslam.maps import MapObject, object_colour
from meshslam.viewing.context import ReportContext, TrueObject
from meshslam.viewing.doubts import doubts, position_sigma_m, seen_share
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
    "objects_moving": Figure(RUN, "objects that drive", "", 0),
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
    "drives": Figure(RUN, "drives", "", 0),
    "drives_in_world": Figure(RUN, "drives in one world", "", 0),
    "worlds": Figure(RUN, "worlds", "", 0),
    "cars_of_several_drives": Figure(RUN, "cars of several drives", "", 0),
    "cars_moved": Figure(RUN, "cars that moved", "", 0),
    "cars_gone": Figure(RUN, "cars that have gone", "", 0),
    "cars_new": Figure(RUN, "cars that came", "", 0),
    "alignment_sigma_max_m": Figure(RUN, "drives' positions known to", "m", 3),
    "alignment_residual_median_m": Figure(RUN, "shared cars apart, median", "m", 3),
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
    "seconds_merging": Figure(COST, "merging", "s", 1),
    "seconds_localization": Figure(COST, "localization", "s", 1),
    "seconds_imports": Figure(COST, "start and imports", "s", 1),
    "position_sigma_mean_m": Figure(RUN, "sigma of a position, mean", "m", 3),
    "rotation_sigma_mean_deg": Figure(RUN, "sigma of a rotation, mean", "°", 3),
    "seconds_live": Figure(COST, "live", "s", 1),
    "seconds_report": Figure(COST, "report", "s", 1),
    "milliseconds_per_frame": Figure(COST, "per frame", "ms", 0),
    "peak_memory_mb": Figure(COST, "peak memory", "MB", 0),
}
STAGES = (
    "seconds_imports",
    "seconds_perception",
    "seconds_tracking",
    "seconds_localization",
    "seconds_mapping",
    "seconds_live",
    "seconds_report",
)
EXPLAINED = {
    "mask IoU": "overlap of the mesh with the masks, mean over the views",
    "position, 1 &sigma;": "standard deviation along the least certain axis",
    "surface measured": "share of the vertices that the views fix to 5 cm; the rest follows the category's shapes",
}
ERROR = "distance of the centre from the true one"
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
    if not context.map.objects:
        return "<p class=none>No object is in the map.</p>"
    errors = {true.estimated_id: true for true in context.true_objects if true.estimated_id is not None}
    headings = ["", "id", "category", "length &times; width &times; height", "views", "frames"]
    headings += [f'<abbr title="{why}">{name}</abbr>' for name, why in EXPLAINED.items()]
    headings += [*([f'<abbr title="{ERROR}">error</abbr>'] if errors else []), "doubts"]
    rows = [_object_row(thing, errors) for thing in context.map.objects]
    return table(headings, rows, "objects")


def _object_row(thing: MapObject, errors: Mapping[int, TrueObject]) -> list[str]:
    frames = UNKNOWN if thing.first_frame is None else f"{thing.first_frame}&ndash;{thing.last_frame}"
    sigma, seen, said = position_sigma_m(thing), seen_share(thing), doubts(thing)
    true = errors.get(thing.id)
    error = [_with_unit(None if true is None else true.centre_error_m, 2, "m")] if errors else []
    return [
        f'<canvas class=thumb data-id="{thing.id}" width=144 height=96 aria-hidden=true></canvas>',
        chip(thing.id),
        text(thing.category),
        f"{size_m(thing.dimensions)}<small> m</small>",
        str(thing.views),
        frames,
        number(thing.mask_iou, 3),
        _with_unit(None if sigma is None else 100 * sigma, 1, "cm"),
        _with_unit(None if seen is None else 100 * seen, 0, "%"),
        *error,
        f"<span class=doubt>{text('; '.join(said))}</span>" if said else "<small>none</small>",
    ]


def chip(number_of_object: int) -> str:
    """A button that selects an object."""
    colour = rgb(object_colour(number_of_object))
    return (
        f'<button type=button class=chip data-id="{number_of_object}" aria-pressed=false>'
        f'<i style="background:{colour}"></i>{number_of_object}</button>'
    )


def _with_unit(value: float | None, decimals: int, unit: str) -> str:
    return number(value, decimals) + ("" if value is None else f"<small> {unit}</small>")


def iou_bars(context: ReportContext) -> str:
    """Mask IoU of each object as a bar that selects it; empty where none is known."""
    known = [(thing.id, thing.mask_iou) for thing in context.map.objects if thing.mask_iou is not None]
    rows = [
        f'<li>{chip(number_)}<span class=track><span style="width:{100 * iou:.1f}%"></span></span><b>{iou:.3f}</b></li>'
        for number_, iou in known
    ]
    return f"<ol class='bars ious'>{''.join(rows)}</ol>" if rows else ""


def time_bars(metrics: Mapping[str, float]) -> str:
    """Seconds of each stage as bars; empty where none are known."""
    seconds = {key: metrics[key] for key in STAGES if key in metrics}
    longest = max(seconds.values(), default=0.0)
    rows = [
        f"<li><span>{text(describe(key).label)}</span>"
        f'<span class=track><span style="width:{100 * took / longest:.1f}%"></span></span>'
        f"<b>{number(took, 2)}<small> s</small></b></li>"
        for key, took in seconds.items()
        if longest > 0
    ]
    return f"<ol class='bars times'>{''.join(rows)}</ol>" if rows else ""


def notes_list(context: ReportContext) -> str:
    """What the run told its user; empty if that is nothing."""
    rows = "".join(f"<li>{text(note)}</li>" for note in context.notes)
    return f"<ul>{rows}</ul>" if rows else ""


def left_out_list(context: ReportContext) -> str:
    """Tracks that are no objects, with a picture and the reason; empty if there are none."""
    rows = [
        f'<li><canvas class=lost data-id="{track}" width=240 height=160 aria-hidden=true></canvas>'
        f"<div><b>track {track}</b> <span class=reason>{text(reason)}</span><p>{text(detail)}</p>"
        f'<button type=button class=to-frame data-id="{track}" hidden>show it</button></div></li>'
        for track, reason, detail in context.left_out
    ]
    return f"<ul class=lost-list>{''.join(rows)}</ul>" if rows else ""
