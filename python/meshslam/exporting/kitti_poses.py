"""KITTI odometry's poses: the upper 3 x 4 of first_camera_from_camera a line, without times."""

from __future__ import annotations

from pathlib import Path

from meshslam.exporting.finished_run import FinishedRun
from meshslam.exporting.formats import Notes


def write(run: FinishedRun, target: Path) -> Notes:
    """The world is the first camera: x right, y down, z ahead."""
    poses = run.path.world_from_camera
    first_from_world = poses[0].inverse() if poses else None
    rows = [] if first_from_world is None else [(first_from_world @ pose).matrix[:3].ravel() for pose in poses]
    lines = (" ".join(f"{value + 0.0:.9e}" for value in row) for row in rows)
    target.write_text("".join(f"{line}\n" for line in lines), encoding="ascii")
    return ("kitti: times are not part of the format: times.txt of the recording has them",)
