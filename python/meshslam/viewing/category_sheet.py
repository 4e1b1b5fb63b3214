"""A category on one sheet: the mean from four sides, and what each mode does."""

from __future__ import annotations

from html import escape

import cv2
import numpy as np

from meshslam.categories import Category
from meshslam.geometry.arrays import Bytes, Floats, Ints
from meshslam.geometry.lie import exp_so3
from meshslam.viewing.markup import png_uri

TILE = (300, 190)  # px, width and height
SPREAD = (-2.0, 2.0)  # sigmas at which a mode is shown
SHOWN = 12  # modes
LIGHT = np.array([0.3, 0.5, 0.8]) / np.linalg.norm([0.3, 0.5, 0.8])
VIEWS = {"side": (0.0, 0.0), "front": (90.0, 0.0), "above": (0.0, 90.0), "three quarters": (35.0, 20.0)}


def category_sheet(category: Category) -> Bytes:
    """The sheet as an image (h, w, 3) BGR, by painting: a row of the mean, a row a mode at -2 and +2 sigma."""
    shown = [category.vertices, *(category.vertices + s * mode for mode in category.modes[:SHOWN] for s in SPREAD)]
    extent = 1.15 * max(float(np.ptp(shape, axis=0).max()) for shape in shown)
    rows = [[_tile(category, category.vertices, view, extent, f"mean, {view}", points=True) for view in VIEWS]]
    for number, mode in enumerate(category.modes[:SHOWN]):
        label = f"mode {number + 1}"
        row = []
        for view in ("side", "three quarters"):
            for sigma in SPREAD:
                shape = category.vertices + sigma * mode
                row.append(_tile(category, shape, view, extent, f"{label}, {sigma:+.0f} sigma", points=False))
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


def _tile(category: Category, vertices: Floats, view: str, extent: float, label: str, *, points: bool) -> Bytes:
    turn = _view(*VIEWS[view])
    seen = vertices @ turn.T
    scale = TILE[0] / extent

    def at(p: Floats) -> Floats:
        pixels: Floats = np.array(TILE) / 2 + scale * p[..., :2] * [1, -1]
        return pixels

    image = np.full((TILE[1], TILE[0], 3), 255, np.uint8)
    _paint(image, at(seen), seen, category.faces, turn @ LIGHT)
    if points:
        for x, y in at(category.keypoints(vertices) @ turn.T):
            cv2.circle(image, (round(x), round(y)), 3, (30, 30, 220), -1, cv2.LINE_AA)
    cv2.putText(image, label, (8, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (60, 60, 60), 1, cv2.LINE_AA)
    return image


def _view(yaw_deg: float, pitch_deg: float) -> Floats:
    """view_from_object: x right, y up, z towards the viewer, who stands on the object's right at 0, 0."""
    side = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    pitch = exp_so3(np.array([np.radians(pitch_deg), 0, 0]))
    turn: Floats = pitch @ side @ exp_so3(np.array([0, 0, -np.radians(yaw_deg)]))
    return turn


def _paint(image: Bytes, pixels: Floats, seen: Floats, faces: Ints, light: Floats) -> None:
    """Fill the front faces from far to near, shaded by their normals."""
    corners = seen[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    shade = 70 + 165 * np.clip(0.5 + 0.5 * normal @ light, 0, 1)
    front = np.flatnonzero(normal[:, 2] > 0)
    for face in front[np.argsort(corners[front, :, 2].mean(1), kind="stable")]:
        outline = np.round(16 * pixels[faces[face]]).astype(np.int32)
        tone = float(shade[face])
        cv2.fillConvexPoly(image, outline, (tone, 0.86 * tone, 0.72 * tone), cv2.LINE_AA, 4)
