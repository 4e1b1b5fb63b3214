"""One HTML file that shows a run: it opens offline, everything is inside."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from string import Template

from meshslam.viewing.context import ReportContext
from meshslam.viewing.markup import asset, number, script, script_json, text
from meshslam.viewing.moving_page import moving_table
from meshslam.viewing.page_data import page_data
from meshslam.viewing.page_frames import PageFrame, page_frames, shown_frames
from meshslam.viewing.path_charts import ITERATION
from meshslam.viewing.tables import (
    describe,
    figures_table,
    iou_bars,
    left_out_list,
    notes_list,
    objects_table,
    time_bars,
)

SCRIPTS = (  # of assets/page, in the order of their needs
    "run",
    "state",
    "linear",
    "colours",
    "silhouette",
    "images",
    "crop",
    "programs",
    "scene",
    "viewer",
    "frame",
    "player",
    "plan",
    "chart",
    "car",
    "main",
)
HEADLINES = ("mask_iou_shape", "voxel_iou_mean", "recall", "ate_rmse_m", "milliseconds_per_frame")
HEADLINE_LABELS = {"mask_iou_shape": "mask IoU", "voxel_iou_mean": "voxel IoU", "milliseconds_per_frame": "per frame"}


def write_report(context: ReportContext, last_metrics: Callable[[], Mapping[str, float]] | None = None) -> str:
    """The whole page as text; each image is read once or twice, and only a few of them are in memory.

    `last_metrics` is asked for the figures once everything else is done, in place of the context's: so that they can
    hold what the report took.
    """
    frames = page_frames(context, shown_frames(context))
    data, objects, left_out = script_json(page_data(context, frames)), objects_table(context), left_out_list(context)
    context = context if last_metrics is None else replace(context, metrics=last_metrics())
    return Template(asset("report.html")).substitute(
        title=text(context.title),
        style=asset("report.css"),
        headline=_headline(context),
        objects=objects,
        ious=_section("mask-iou", "Mask IoU of each object", iou_bars(context)),
        moving=_section("moving", "Objects that drive", moving_table(context)),
        left_out=_section("left-out", "Left out", left_out),
        notes=_section("notes", "Notes", notes_list(context)),
        times=_section("times", "Time", time_bars(context.metrics)),
        figures=_section("figures", "Figures", _figures(context)),
        images="".join(map(_image, frames)),
        data=data,
        script=script(*SCRIPTS),
    )


def _image(frame: PageFrame) -> str:
    return "" if frame.image is None else f'<script type="image/jpeg" class=image>{frame.image}</script>'


def _section(name: str, heading: str, content: str) -> str:
    return f'<section id="{name}"><h2>{heading}</h2>{content}</section>' if content else ""


def _figures(context: ReportContext) -> str:
    return figures_table({key: value for key, value in context.metrics.items() if not key.startswith(ITERATION)})


def _headline(context: ReportContext) -> str:
    """What to know first."""
    tiles = [("objects", str(len(context.map))), ("frames", str(len(context.frame_ids)))]
    if context.map.moving:
        tiles.insert(1, ("that drive", str(len(context.map.moving))))
    for key in HEADLINES:
        if key in context.metrics:
            shown = describe(key)
            value = f"{number(context.metrics[key], shown.decimals)}<small> {shown.unit}</small>"
            tiles.append((HEADLINE_LABELS.get(key, shown.label), value))
    return "".join(f"<div><dt>{label}</dt><dd>{value}</dd></div>" for label, value in tiles)
