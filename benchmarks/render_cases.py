"""What the renderer's benchmarks look at: a car on the road ahead, its observed mask, and runs taken in turn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Camera, MaskLoss, Pose, render

CAMERA = Camera(1242, 375, 721.5, 721.5, 609.6, 172.9)
AHEAD = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])  # camera from an object that faces away
DISTANCES_M = (8.0, 15.0, 30.0)


@dataclass(frozen=True, eq=False)
class Mesh:
    """Vertices and faces."""

    vertices: np.ndarray
    faces: np.ndarray


def pose_at(distance_m: float, yaw_rad: float = 0.7, aside_m: float = 0.0) -> Pose:
    """Camera from object for a car on the road ahead."""
    return Pose(AHEAD @ Pose.from_yaw(yaw_rad, np.zeros(3)).rotation, np.array([aside_m, 0.9, distance_m]))


def observed_at(mesh: Mesh, distance_m: float, yaw_rad: float = 0.75, aside_m: float = 0.15) -> np.ndarray:
    """What a camera saw: the car a little larger, turned and moved."""
    return render(CAMERA, [(pose_at(distance_m, yaw_rad, aside_m), mesh.vertices * 1.03, mesh.faces)]).mask


def box_around(*masks: np.ndarray, margin: int = 3) -> tuple[int, int, int, int]:
    """Rectangle (x0, y0, x1, y1) around what any mask covers."""
    rows, columns = np.nonzero(np.any(masks, axis=0))
    x0, y0 = max(0, columns.min() - margin), max(0, rows.min() - margin)
    return x0, y0, min(CAMERA.width, columns.max() + margin + 1), min(CAMERA.height, rows.max() + margin + 1)


def cropped_loss(mesh: Mesh, observed: np.ndarray, box: tuple[int, int, int, int] | None = None) -> MaskLoss:
    """The loss against a mask that is cropped to a box, its own if none is given, as detections are."""
    x0, y0, x1, y1 = box or box_around(observed)
    return MaskLoss(CAMERA, len(mesh.vertices), mesh.faces, observed[y0:y1, x0:x1], (int(x0), int(y0)))


def interleaved(timers: dict[str, Callable[[], list[float]]], rounds: int) -> dict[str, np.ndarray]:
    """Milliseconds of several things, taken in turn so that the machine's moods meet all of them."""
    found: dict[str, list[float]] = {name: [] for name in timers}
    for _ in range(rounds):
        for name, timer in timers.items():
            found[name] += timer()
    return {name: np.array(values) * 1e3 for name, values in found.items()}
