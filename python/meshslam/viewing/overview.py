"""A page over several runs: their figures beside each other, and where each report is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from string import Template

from meshslam.viewing.context import ReportContext
from meshslam.viewing.markup import asset, number, script, script_json, table, text
from meshslam.viewing.page_data import page_data
from meshslam.viewing.tables import MASKS, describe

MAP = '<div id="map"></div><div class="legend" id="map-legend"></div>'
PLAN_SCRIPTS = ("run", "state", "linear", "colours", "plan", "overview")
SHOWN = (
    "objects_mapped",
    "recall",
    "voxel_iou_category_model",
    "voxel_iou_mean",
    "centre_error_median_m",
    "yaw_error_median_deg",
    "mask_iou_shape",
    "ate_initial_rmse_m",
    "ate_rmse_m",
    "end_error_percent",
    "seconds_total",
)


def figure_rows(runs: Mapping[str, Mapping[str, float]]) -> list[tuple[str, list[str]]]:
    """Label with unit, and a text a run, of each figure of SHOWN that any run has."""
    rows = []
    for key in SHOWN:
        if any(key in figures for figures in runs.values()):
            shown = describe(key)
            named = f"mask IoU, {shown.label}" if shown.group == MASKS else shown.label
            label = f"{named}, {shown.unit}" if shown.unit else named
            cells = [f"{figures[key]:.{shown.decimals}f}" if key in figures else "" for figures in runs.values()]
            rows.append((label, cells))
    return rows


def overview_page(
    title: str,
    intro: str,
    runs: Mapping[str, Mapping[str, float]],
    pages: Mapping[str, str],
    figures: Sequence[tuple[str, str]] = (),
    plan: tuple[str, ReportContext] | None = None,
) -> str:
    """One HTML page; `pages` are the runs' reports, relative to it, `figures` captions with the markup above them.

    `plan` is a caption and the run whose map from above is drawn under it.
    """
    head = ["", *(f'<a href="{text(pages[name])}">{text(name)}</a>' for name in runs)]
    rows = [[text(label), *(text(cell) or number(None, 0) for cell in cells)] for label, cells in figure_rows(runs)]
    return Template(asset("overview.html")).substitute(
        title=text(title),
        intro=text(intro),
        style=asset("report.css"),
        links=" ".join(f'<a class=button href="{text(pages[name])}">{text(name)}</a>' for name in runs),
        table=table(head, rows, "compare"),
        figures="".join(_figure(caption, markup) for caption, markup in figures),
        plan="" if plan is None else _figure(plan[0], MAP),
        data="" if plan is None else script_json(page_data(plan[1], [])),
        script="" if plan is None else script(*PLAN_SCRIPTS),
    )


def _figure(caption: str, markup: str) -> str:
    return f"<section><figure class=overview>{markup}<figcaption>{text(caption)}</figcaption></figure></section>"
