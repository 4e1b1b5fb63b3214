"""A category on one sheet: the mean from four sides, and what each mode does."""

from __future__ import annotations

from html import escape

import cv2
import numpy as np

from meshslam.categories import Category
from meshslam.geometry import Bytes, Floats
from meshslam.viewing.markup import png_uri
from meshslam.viewing.mesh_drawing import VIEWS, mesh_picture

SPREAD = (-2.0, 2.0)  # sigmas at which a mode is shown
SHOWN = 12  # modes


def category_sheet(category: Category) -> Bytes:
    """The sheet as an image (h, w, 3) BGR, by painting: a row of the mean, a row a mode at -2 and +2 sigma."""
    shown = [category.vertices, *(category.vertices + s * mode for mode in category.modes[:SHOWN] for s in SPREAD)]
    extent = 1.15 * max(float(np.ptp(shape, axis=0).max()) for shape in shown)
    mean, faces = category.vertices, category.faces
    points = category.keypoints(mean)
    rows = [[mesh_picture(mean, faces, view, extent, f"mean, {view}", points) for view in VIEWS]]
    for number, mode in enumerate(category.modes[:SHOWN]):
        label = f"mode {number + 1}"
        row = []
        for view in ("side", "three quarters"):
            for sigma in SPREAD:
                shape = category.vertices + sigma * mode
                row.append(mesh_picture(shape, faces, view, extent, f"{label}, {sigma:+.0f} sigma"))
        rows.append(row)
    sheet: Bytes = np.vstack([np.hstack(row) for row in rows])
    return sheet


def category_png(category: Category) -> bytes:
    """The sheet as a PNG file's bytes."""
    return cv2.imencode(".png", category_sheet(category))[1].tobytes()


def mode_rms(category: Category) -> Floats:
    """Metres (M,) by which one sigma of each mode moves the surface: root mean square over vertices."""
    rms: Floats = np.sqrt((category.modes**2).sum(2).mean(1))
    return rms


def category_page(category: Category) -> str:
    """The sheet with its figures as one HTML page that needs nothing else."""
    length, width, height = category.dimensions
    rows = "".join(f"<tr><td>{i + 1}</td><td>{rms:.3f} m</td></tr>" for i, rms in enumerate(mode_rms(category)))
    points = ", ".join(map(escape, category.keypoint_names)) or "none"
    return (
        f'<!doctype html><meta charset="utf-8"><title>{escape(category.name)}</title>'
        "<style>body{font:15px system-ui,sans-serif;margin:2em;color:#222}img{max-width:100%}td{padding:0 1em}</style>"
        f"<h1>{escape(category.name)}</h1><p>{len(category.vertices)} vertices, {len(category.faces)} faces, "
        f"{len(category.modes)} modes; mean {length:.2f} x {width:.2f} x {height:.2f} m. Key points: {points}.</p>"
        f'<img alt="mean and modes" src="{png_uri(category_sheet(category))}">'
        f"<h2>What one sigma of a mode moves</h2><table>{rows}</table>\n"
    )
