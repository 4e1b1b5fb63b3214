"""Camera paths from files of their own: TUM, EuRoC and VINS, or KITTI's twelve numbers a line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.sequences.conventions import WORLD_FROM_FIRST_CAMERA
from meshslam.sequences.pose_files import read_euroc, read_tum_times
from meshslam.sequences.report import Report, fail
from meshslam.sequences.text import read_table, read_text, read_times, rigid


@dataclass(frozen=True, eq=False)
class PathFile:
    """A path as a file has it; without times, as KITTI's, `times_s` counts its lines."""

    times_s: Floats  # (n,), increasing
    world_from_camera: tuple[Pose, ...]
    has_times: bool
    notes: tuple[str, ...]


def read_path(poses: Path, times: Path | None = None) -> tuple[Floats, tuple[Pose, ...]]:
    """Times (n,) in seconds, and world_from_camera, as `read_path_file` reads them; KITTI's poses need `times`."""
    found = read_path_file(poses, times)
    if not found.has_times:
        raise fail(poses, "", "KITTI's poses have no times: give --times FILE with one a line")
    return found.times_s, found.world_from_camera


def read_path_file(poses: Path, times: Path | None = None) -> PathFile:
    """Read TUM's eight numbers a line, EuRoC's and VINS' comma-separated lines, or KITTI's twelve numbers a line.

    KITTI's poses have their axes renamed to (z, -x, -y); `times`, one a line, are theirs. Nanoseconds are told by their
    size. SequenceError names the file and the line that is wrong.
    """
    report = Report()
    lines = [text for line in read_text(poses).splitlines() if (text := line.strip()) and text[0] != "#"]
    if not lines:
        raise fail(poses, "", "holds no poses")
    words = lines[0].split()
    if "," in lines[0]:
        times_s, path = read_euroc(poses, report)
    elif len(words) == 8:
        times_s, path = read_tum_times(poses, report)
    elif len(words) == 12:
        return _kitti(poses, times, report)
    else:
        raise fail(
            poses, "", f"expected 8 numbers a line (TUM), 12 (KITTI) or commas (EuRoC, VINS), found {len(words)}"
        )
    return PathFile(times_s, path, True, report.notes)


def _kitti(poses: Path, times: Path | None, report: Report) -> PathFile:
    table = read_table(poses, 12, report, by_line=True)
    times_s = np.arange(len(table.rows), dtype=float) if times is None else read_times(times, report)
    if times is not None and len(times_s) != len(table.rows):
        raise fail(times, "", f"holds {len(times_s)} times, but {poses} has {len(table.rows)} poses")
    path = tuple(
        WORLD_FROM_FIRST_CAMERA @ rigid(poses, f"line {line}", row.reshape(3, 4), report)
        for line, row in zip(table.lines, table.rows, strict=True)
    )
    return PathFile(times_s, path, times is not None, report.notes)
