"""Whether intrinsics belong to their image."""

from __future__ import annotations

import numpy as np

from meshslam.geometry import Camera
from meshslam.plausibility.finding import Finding, Severity

_CENTRE_SHARE = 0.3  # by which the principal point may be off the middle, of width and height
_ASPECT = 1.1  # fx over fy
_FIELD_DEG = (10.0, 160.0)  # of view, across


def judge_camera(camera: Camera, source: str) -> list[Finding]:
    """Principal point near the middle, square pixels, a field of view that pinhole cameras have."""
    found = []
    off = (camera.cx / camera.width - 0.5, camera.cy / camera.height - 0.5)
    if max(map(abs, off)) > _CENTRE_SHARE:
        message = (
            f"{source}: the principal point ({camera.cx:.0f}, {camera.cy:.0f}) lies far from the middle of "
            f"{camera.width}x{camera.height}: intrinsics are fx, fy, cx, cy, of this resolution"
        )
        severity = _severity(max(map(abs, off)) > 0.5)
        found.append(Finding("camera_centre", message, severity, {"cx": camera.cx, "cy": camera.cy}))
    aspect = camera.fx / camera.fy
    if not 1 / _ASPECT < aspect < _ASPECT:
        differ = f"fx {camera.fx:.1f} and fy {camera.fy:.1f} differ by {100 * abs(aspect - 1):.0f}%"
        severity = _severity(not 0.5 < aspect < 2.0)
        message = f"{source}: {differ}: pixels are mostly square"
        found.append(Finding("camera_aspect", message, severity, {"fx": camera.fx, "fy": camera.fy}))
    field_deg = float(np.degrees(2 * np.arctan(camera.width / (2 * camera.fx))))
    if not _FIELD_DEG[0] < field_deg < _FIELD_DEG[1]:
        size = f"{camera.width}x{camera.height}"
        message = f"{source}: the field of view is {field_deg:.1f}° across: fx is in pixels of {size}"
        found.append(Finding("camera_field", message, "error", {"field_of_view_deg": field_deg}))
    return found


def _severity(bad: bool) -> Severity:
    return "error" if bad else "note"
