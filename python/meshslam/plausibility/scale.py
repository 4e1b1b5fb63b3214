"""Whether known poses are in metres: the depths of objects by their sizes against their depths by parallax."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from meshslam.geometry import Camera, Floats, Pose
from meshslam.perception import Detection
from meshslam.plausibility.finding import Finding

_MIN_TRACKS, _MIN_VIEWS = 3, 4
_MIN_PARALLAX_RAD = 0.05
_EDGE_PX = 4.0
_ONCOMING = 0.3  # of cars that come at 2.3 times the camera's speed
_RANGE = (0.6, 1.7)  # of depths by parallax over depths by size


def judge_scale(
    camera: Camera,
    pose_of_frame: Mapping[int, Pose],
    tracks: Mapping[int, Sequence[Detection]],
    height_m: Mapping[str, float],
    source: str,
) -> list[Finding]:
    """`height_m` are usual heights of the categories; tracks seen from one direction do not count.

    Oncoming cars look nearer by parallax, as a camera does whose poses are too short: what they can explain is noted,
    and is no error.
    """
    ratios = [r for t in tracks.values() if (r := depth_ratio(camera, pose_of_frame, t, height_m)) is not None]
    if len(ratios) < _MIN_TRACKS:
        return []
    ratio = float(np.median(ratios))
    if _RANGE[0] < ratio < _RANGE[1]:
        return []
    message = (
        f"{source}: by parallax {len(ratios)} objects stand {ratio:.2f} times as far away as their sizes say: the "
        f"poses are not in metres (a monocular path has any scale): --poses-scale {1 / ratio:.3g} makes them so, about"
    )
    figures = {"scale": ratio, "tracks": len(ratios)}
    if _ONCOMING < ratio < _RANGE[0]:
        doubt = f"{message}; or most of them are oncoming cars, which look nearer, and the poses are right"
        return [Finding("poses_scale", doubt, "note", figures=figures)]
    return [Finding("poses_scale", message, figures=figures)]


def depth_ratio(
    camera: Camera, pose_of_frame: Mapping[int, Pose], detections: Sequence[Detection], height_m: Mapping[str, float]
) -> float | None:
    """Depth by parallax over depth by the box's height, median over detections; None where it tells nothing."""
    known = [d for d in detections if d.frame in pose_of_frame and d.category in height_m]
    whole = [d for d in known if not _is_cut(d, camera)]
    if len(whole) < _MIN_VIEWS:
        return None
    poses = [pose_of_frame[d.frame] for d in whole]
    rays = np.array([p.rotation @ camera.rays(_middle(d)) for p, d in zip(poses, whole, strict=True)])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    if float(np.arccos(np.clip(rays @ rays[0], -1, 1)).max()) < _MIN_PARALLAX_RAD:
        return None
    place = _meeting_point(np.array([p.translation for p in poses]), rays)
    depths = np.array([p.inverse().transform(place)[2] for p in poses])
    by_size = np.array([camera.fy * height_m[d.category] / max(d.bbox[3], 1.0) for d in whole])
    return float(np.median(depths / by_size)) if (depths > 0).all() else None


def _meeting_point(eyes: Floats, rays: Floats) -> Floats:
    """The point (3,) nearest to all rays."""
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    normal = across.sum(0) + 1e-9 * np.eye(3)
    point: Floats = np.linalg.solve(normal, (across @ eyes[..., None]).sum(0))[:, 0]
    return point


def _middle(detection: Detection) -> Floats:
    x, y, w, h = detection.bbox
    return np.array([x + w / 2, y + h / 2])


def _is_cut(detection: Detection, camera: Camera) -> bool:
    x, y, w, h = detection.bbox
    return x < _EDGE_PX or y < _EDGE_PX or x + w > camera.width - _EDGE_PX or y + h > camera.height - _EDGE_PX
