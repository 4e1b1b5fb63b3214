"""A COLMAP text model: cameras.txt, images.txt, points3D.txt (colmap.github.io/format.html)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from meshslam.errors import ConfigError
from meshslam.exporting.finished_run import FinishedRun
from meshslam.exporting.formats import Notes
from meshslam.geometry import quaternions_of_rotations
from meshslam.maps import object_colour

PIXEL_CENTRE = 0.5  # of the first pixel, for COLMAP; ours is 0
UNKNOWN_ERROR = -1


def write(run: FinishedRun, target: Path) -> Notes:
    """Images are undistorted ones; points are the vertices that were seen, in the colours of their objects."""
    camera = run.camera
    if camera.skew:
        raise ConfigError(f"--format colmap: the camera has a skew of {camera.skew:g} px, COLMAP's PINHOLE has none")
    target.mkdir()
    numbers = [camera.fx, camera.fy, camera.cx + PIXEL_CENTRE, camera.cy + PIXEL_CENTRE]
    lens = " ".join(f"{value:.9g}" for value in numbers)
    (target / "cameras.txt").write_text(
        f"# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n1 PINHOLE {camera.width} {camera.height} {lens}\n",
        encoding="ascii",
    )
    (target / "images.txt").write_text(_images(run), encoding="utf-8")
    (target / "points3D.txt").write_text(_points(run), encoding="ascii")
    return ("colmap: points have no tracks, and images are the undistorted ones of camera.yaml",)


def _images(run: FinishedRun) -> str:
    lines = ["# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME", "# POINTS2D[] as (X, Y, POINT3D_ID)"]
    for index, pose in enumerate(run.path.world_from_camera):
        camera_from_world = pose.inverse()
        x, y, z, w = quaternions_of_rotations(camera_from_world.rotation[None])[0]
        numbers = [w, x, y, z, *camera_from_world.translation]
        cells = " ".join(f"{value + 0.0:.12g}" for value in numbers)
        lines += [f"{index + 1} {cells} 1 {run.image_name(index)}", ""]
    return "\n".join(lines) + "\n"


def _points(run: FinishedRun) -> str:
    lines = ["# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)"]
    for thing in run.scene.objects:
        seen = np.ones(len(thing.vertices), bool) if thing.vertex_observed is None else thing.vertex_observed
        colour = " ".join(map(str, object_colour(thing.id).tolist()))
        for point in thing.vertices_in_world[seen]:
            place = " ".join(f"{value + 0.0:.9g}" for value in point)
            lines.append(f"{len(lines)} {place} {colour} {UNKNOWN_ERROR}")
    return "\n".join(lines) + "\n"
