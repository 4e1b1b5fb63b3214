"""A page over several runs: their figures beside each other, and where each report is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from meshslam.viewing.markup import asset, number, table, text
from meshslam.viewing.tables import MASKS, describe

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
) -> str:
    """One HTML page; `pages` are the runs' reports, relative to it, `figures` captions with the markup above them."""
    head = ["", *(f'<a href="{text(pages[name])}">{text(name)}</a>' for name in runs)]
    rows = [[text(label), *(text(cell) or number(None, 0) for cell in cells)] for label, cells in figure_rows(runs)]
    shown = "".join(
        f"<figure class=overview>{markup}<figcaption>{text(caption)}</figcaption></figure>"
        for caption, markup in figures
    )
    return (
        f'<!doctype html><html lang=en><head><meta charset="utf-8"><title>{text(title)}</title>'
        f"<style>{asset('report.css')}</style></head><body><main><h1>{text(title)}</h1><p>{text(intro)}</p>"
        f"{table(head, rows)}{shown}</main></body></html>\n"
    )
