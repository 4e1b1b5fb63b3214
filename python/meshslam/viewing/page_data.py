"""A run as data for the page's script: see `assets/page/run.js` for the reader of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.viewing.context import ReportContext
from meshslam.viewing.markup import packed
from meshslam.viewing.moving_page import moving_data
from meshslam.viewing.overlay import keypoint_colour, visible_keypoints
from meshslam.viewing.page_frames import PageFrame, frames_data
from meshslam.viewing.path_charts import ITERATION
from meshslam.viewing.scene3d import scene_data, scene_origin

PATH_POINTS = 4000


def page_data(context: ReportContext, frames: list[PageFrame]) -> dict[str, Any]:
    """Everything that is drawn in the browser; arrays are base64, little-endian, metres relative to `origin`."""
    camera, origin = context.camera, scene_origin(context.map, context.world_from_camera)
    return {
        "camera": {
            "width": camera.width,
            "height": camera.height,
            "fx": camera.fx,
            "fy": camera.fy,
            "cx": camera.cx,
            "cy": camera.cy,
            "skew": camera.skew,
        },
        "frames": frames_data(context, frames, origin),
        "scene": scene_data(context, origin),
        "moving": moving_data(context, origin),
        "paths": [_path("estimate", context.world_from_camera, origin), *_others(context, origin)],
        "series": _series(context),
        "iterations": [context.metrics[key] for key in sorted(context.metrics) if key.startswith(ITERATION)],
        "left_out": [track for track, _, _ in context.left_out],
        "keypoints": _keypoints(context),
    }


def _path(name: str, poses: tuple[Pose, ...], origin: Floats) -> dict[str, str]:
    points = np.array([pose.translation for pose in poses]).reshape(-1, 3) - origin
    kept = points[:: len(points) // PATH_POINTS + 1]
    ends = [kept, points[-1:]] if len(points) and not np.array_equal(kept[-1], points[-1]) else [kept]
    return {"name": name, "points": packed(np.concatenate(ends).astype(np.float32))}


def _others(context: ReportContext, origin: Floats) -> list[dict[str, str]]:
    return [_path(name, poses, origin) for name, poses in context.other_paths.items()]


def _series(context: ReportContext) -> dict[str, Any]:
    """What is known of each pose: its time from the first, sigmas, errors; null where there is no truth at its time."""
    times = np.asarray(context.times_s, float)
    found: dict[str, Any] = {"times": _rounded(times - times[0] if len(times) else times, 4)}
    if context.covariances is not None:
        for name, part, unit in (("position", slice(0, 3), 1.0), ("rotation", slice(3, 6), np.degrees(1.0))):
            variances = np.trace(context.covariances[:, part, part], axis1=1, axis2=2)
            found[f"{name}_sigma"] = _rounded(unit * np.sqrt(np.maximum(variances, 0.0)), 5)
    return found | {"errors": _errors(context.path_errors)}


def _errors(errors: Mapping[str, Floats]) -> list[dict[str, Any]]:
    return [
        {"name": name, "position": _rounded(rows[:, 0], 5), "rotation": _rounded(rows[:, 1], 5)}
        for name, rows in errors.items()
    ]


def _rounded(values: Floats, decimals: int) -> list[float | None]:
    rounded = np.round(values, decimals) + 0.0
    return [value if np.isfinite(value) else None for value in rounded.tolist()]


def _keypoints(context: ReportContext) -> list[dict[str, str]]:
    """Names and colours of the key points; empty if no detection has any."""
    if not any(visible_keypoints(d) for d in context.detections.detections):
        return []
    names = max((c.keypoints for c in context.detections.categories), key=len, default=())
    colours = ["#{:02x}{:02x}{:02x}".format(*keypoint_colour(i, len(names))) for i in range(len(names))]
    return [{"name": name, "colour": colour} for name, colour in zip(names, colours, strict=True)]
