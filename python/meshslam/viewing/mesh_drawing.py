"""A mesh alone, from one side."""

from __future__ import annotations

import cv2
import numpy as np

from meshslam.geometry import Bytes, Floats, Ints, exp_so3

TILE = (300, 190)  # px, width and height
LIGHT = np.array([0.3, 0.5, 0.8]) / np.linalg.norm([0.3, 0.5, 0.8])
VIEWS = {"side": (0.0, 0.0), "front": (90.0, 0.0), "above": (0.0, 90.0), "three quarters": (35.0, 20.0)}


def mesh_picture(
    vertices: Floats, faces: Ints, view: str, extent_m: float, label: str, points: Floats | None = None
) -> Bytes:
    """A mesh from one of VIEWS as an image (h, w, 3) BGR that is `extent_m` wide, with points (n, 3) marked."""
    turn = _view(*VIEWS[view])
    seen = vertices @ turn.T
    scale = TILE[0] / extent_m

    def at(p: Floats) -> Floats:
        pixels: Floats = np.array(TILE) / 2 + scale * p[..., :2] * [1, -1]
        return pixels

    image = np.full((TILE[1], TILE[0], 3), 255, np.uint8)
    _paint(image, at(seen), seen, faces, turn @ LIGHT)
    if points is not None:
        for x, y in at(points @ turn.T):
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
