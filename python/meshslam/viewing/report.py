"""One HTML file that shows a run: it opens offline, everything is inside."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from string import Template

from meshslam.viewing.context import ReportContext
from meshslam.viewing.crops import choose_crops, crops, draw_pair
from meshslam.viewing.filmstrip import FramePicture, choose_frames, draw_frame, filmstrip, keypoint_legend
from meshslam.viewing.from_above import birds_eye
from meshslam.viewing.markup import asset, number, script_json, text
from meshslam.viewing.path_charts import ITERATION
from meshslam.viewing.scene3d import scene_data
from meshslam.viewing.tables import describe, figures_table, left_out_table, objects_table

DRAWERS = 2  # threads; each holds one frame
HEADLINES = ("mask_iou_shape", "voxel_iou_mean", "recall", "ate_rmse_m", "milliseconds_per_frame")
HEADLINE_LABELS = {"mask_iou_shape": "mask IoU", "voxel_iou_mean": "voxel IoU", "milliseconds_per_frame": "per frame"}


def write_report(context: ReportContext, last_metrics: Callable[[], Mapping[str, float]] | None = None) -> str:
    """The whole page as text; each image is read once, and only a few of them are in memory.

    `last_metrics` is asked for the figures once everything else is drawn, in place of the context's: so that they can
    hold what drawing took.
    """
    pictures, pairs = _drawn(context)
    before_after = crops(pairs)
    left_out = left_out_table(context)
    scene = script_json(scene_data(context.map, context.camera, context.world_from_camera))
    plan = birds_eye(context.map, context.world_from_camera, context.other_paths)
    context = context if last_metrics is None else replace(context, metrics=last_metrics())
    return Template(asset("report.html")).substitute(
        title=text(context.title),
        style=asset("report.css"),
        headline=_headline(context),
        frames=filmstrip(pictures) if pictures else "",
        keypoints=keypoint_legend(context),
        plan=plan,
        objects=objects_table(context),
        crops=_section("Category mean and instance", before_after) if before_after else "",
        left_out=_section("Tracks left out", left_out) if left_out else "",
        figures=_figures(context),
        scene=scene,
        viewer=asset("viewer.js"),
        script=asset("report.js"),
    )


def _drawn(context: ReportContext) -> tuple[list[FramePicture], list[str]]:
    """The frames and the pairs of crops, drawn frame by frame."""
    strip, views = choose_frames(context), choose_crops(context)
    indices = sorted({*strip, *(index for index, _ in views.values())})
    frames: dict[int, FramePicture] = {}
    pairs: dict[int, str] = {}

    def draw(index: int) -> None:
        image = None if context.read_image is None else context.read_image(index)
        if index in strip:
            frames[index] = draw_frame(context, index, image)
        for object_id, (where, detection) in views.items():
            if where == index:
                pairs[object_id] = draw_pair(context, context.map[object_id], index, detection, image)

    with ThreadPoolExecutor(DRAWERS) as drawers:
        list(drawers.map(draw, indices))
    return [frames[index] for index in strip], [pairs[object_id] for object_id in views]


def _section(heading: str, content: str) -> str:
    return f"<section><h2>{heading}</h2>{content}</section>"


def _figures(context: ReportContext) -> str:
    """The table of figures, and charts of the path where there are some."""
    shown = {key: value for key, value in context.metrics.items() if not key.startswith(ITERATION)}
    table, drawn = figures_table(shown), "".join(_chart(*chart) for chart in context.charts)
    return (_section("The path", drawn) if drawn else "") + (_section("Figures", table) if table else "")


def _chart(caption: str, png: bytes) -> str:
    data = base64.b64encode(png).decode()
    image = f'<img alt="{text(caption)}" src="data:image/png;base64,{data}">'
    return f"<figure>{image}<figcaption>{text(caption)}</figcaption></figure>"


def _headline(context: ReportContext) -> str:
    """What to know first."""
    tiles = [("objects", str(len(context.map))), ("frames", str(len(context.frame_ids)))]
    for key in HEADLINES:
        if key in context.metrics:
            shown = describe(key)
            value = f"{number(context.metrics[key], shown.decimals)}<small> {shown.unit}</small>"
            tiles.append((HEADLINE_LABELS.get(key, shown.label), value))
    return "".join(f"<div><dt>{label}</dt><dd>{value}</dd></div>" for label, value in tiles)
