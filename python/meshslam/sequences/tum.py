"""Paths as text: `time tx ty tz qx qy qz qw` a line, world_from_camera."""

from __future__ import annotations

from collections.abc import Sequence as Items
from pathlib import Path

import numpy as np

from meshslam.geometry import Floats, Pose, quaternions_of_rotations, rotations_of_quaternions
from meshslam.sequences.report import Report, fail
from meshslam.sequences.text import check_increasing, read_table


def read_tum(path: Path, report: Report) -> tuple[Floats, tuple[Pose, ...]]:
    """Read times (n,) in seconds, increasing, and their poses; quaternions must be of unit length to 1e-2."""
    table = read_table(path, 8, report)
    return poses_of_rows(path, table.rows, table.lines, report)


def poses_of_rows(path: Path, rows: Floats, lines: Items[int], report: Report) -> tuple[Floats, tuple[Pose, ...]]:
    """Times and poses of rows (n, 8), time tx ty tz qx qy qz qw, that stand in these lines of a file."""
    lengths = np.linalg.norm(rows[:, 4:], axis=1)
    rounded = (np.abs(lengths - 1) > 1e-3) & (np.abs(lengths - 1) <= 1e-2)
    if rounded.any():
        first = lines[int(np.argmax(rounded))]
        report.note(path, f"line {first}", f"{rounded.sum()} quaternions are not quite of length 1: made so")
    for i in np.flatnonzero(np.abs(lengths - 1) > 1e-2):
        report.add(path, f"line {lines[int(i)]}", f"the quaternion's length is {lengths[i]:.6g}, expected 1")
    keep = lengths > 1e-9
    kept = rows[keep]
    check_increasing(path, kept[:, 0], tuple(np.array(lines, int)[keep].tolist()), report)
    if not len(kept):
        raise fail(path, "", "holds no poses")
    rotations = rotations_of_quaternions(kept[:, 4:])
    return kept[:, 0], tuple(Pose(r, t) for r, t in zip(rotations, kept[:, 1:4], strict=True))


def format_tum(times_s: Floats, poses: Items[Pose]) -> str:
    """Write poses with nine decimals, the quaternion's w never negative, no minus before zero."""
    if not len(poses):
        return ""
    quaternions = quaternions_of_rotations(np.stack([p.rotation for p in poses]))
    rows = np.column_stack([times_s, np.stack([p.translation for p in poses]), quaternions])
    rows = np.round(rows, 9) + 0.0
    return "".join(" ".join(f"{value:.9f}" for value in row) + "\n" for row in rows)
