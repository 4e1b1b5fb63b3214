"""KITTI object detection's label_2: a file a frame, a line for each car that is seen there (Geiger et al. 2012)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from meshslam.exporting.finished_run import FinishedRun
from meshslam.exporting.formats import Notes
from meshslam.geometry import Camera, Floats, Pose
from meshslam.maps import MapObject

NEAR_M = 0.5  # vertices nearer than this have no pixel
_CLASSES = {"car": "Car", "van": "Van", "truck": "Truck", "bus": "Misc"}
UNKNOWN_OCCLUSION = 3


def write(run: FinishedRun, target: Path) -> Notes:
    """Objects are those that a frame's detections show; the score is that of the detection."""
    target.mkdir()
    for index, frame in enumerate(run.frame_ids):
        lines = []
        for detection in run.found_at(index):
            if detection.track_id is not None and detection.track_id in run.scene:
                thing = run.scene[detection.track_id]
                line = label_line(thing, run.camera_from_object(index, thing.id), run.camera, detection.score)
                lines += [] if line is None else [line]
        (target / f"{frame:06d}.txt").write_text("".join(f"{line}\n" for line in sorted(lines)), encoding="ascii")
    return () if run.detections is not None else ("kitti-labels: no detections in the run: every file is empty",)


def label_line(thing: MapObject, camera_from_object: Pose, camera: Camera, score: float) -> str | None:
    """Type, truncation, occlusion, alpha, box (px), height width length (m), bottom centre (m), rotation_y, score.

    rotation_y turns about the camera's y axis, 0 where the object faces the camera's x axis. None where the object has
    no pixel in the image. How much of it others hide is not said (3).
    """
    points = camera_from_object.transform(thing.vertices)
    if points[:, 2].min() < NEAR_M:
        points = points[points[:, 2] >= NEAR_M]
    if not len(points):
        return None
    pixels = camera.project(points)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    last = np.array([camera.width - 1.0, camera.height - 1.0])
    inside = np.clip(low, 0, last), np.clip(high, 0, last)
    area, seen = np.prod(high - low), np.prod(inside[1] - inside[0])
    if seen <= 0:
        return None
    length, width, height = thing.dimensions
    bottom = camera_from_object.transform(np.array([0.0, 0.0, -height / 2]))
    rotation_y = _rotation_y(camera_from_object.rotation[:, 0])
    alpha = _wrapped(rotation_y - np.arctan2(bottom[0], bottom[2]))
    kind = _CLASSES.get(thing.category, "Misc")
    numbers = [alpha, *inside[0], *inside[1], height, width, length, *bottom, rotation_y]
    cells = " ".join(f"{value + 0.0:.3f}" for value in numbers)
    return f"{kind} {1 - seen / area + 0.0:.2f} {UNKNOWN_OCCLUSION} {cells} {score:.4f}"


def _rotation_y(ahead_in_camera: Floats) -> float:
    """The angle of the object's x axis about the camera's y axis."""
    return float(np.arctan2(-ahead_in_camera[2], ahead_in_camera[0]))


def _wrapped(angle: float) -> float:
    return float((angle + np.pi) % (2 * np.pi) - np.pi)
