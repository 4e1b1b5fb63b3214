"""Camera paths from files of their own: TUM, or KITTI's twelve numbers a line with the times beside them."""

from __future__ import annotations

from pathlib import Path

from meshslam.geometry import Floats, Pose
from meshslam.sequences.conventions import WORLD_FROM_FIRST_CAMERA
from meshslam.sequences.report import Report, fail
from meshslam.sequences.text import read_table, read_text, read_times, rigid
from meshslam.sequences.tum import read_tum


def read_path(poses: Path, times: Path | None = None) -> tuple[Floats, tuple[Pose, ...]]:
    """Times (n,) in seconds, and world_from_camera.

    KITTI's poses have their axes renamed to (z, -x, -y), and need `times`, one a line. SequenceError names the file and
    the line that is wrong.
    """
    report = Report()
    words = next((line.split() for line in read_text(poses).splitlines() if line and not line.startswith("#")), [])
    if len(words) == 8:
        return read_tum(poses, report)
    if len(words) != 12:
        raise fail(poses, "", f"expected 8 numbers a line (TUM) or 12 (KITTI), found {len(words)}")
    if times is None:
        raise fail(poses, "", "KITTI's poses have no times: give --times FILE with one a line")
    table, times_s = read_table(poses, 12, report, by_line=True), read_times(times, report)
    if len(times_s) != len(table.rows):
        raise fail(times, "", f"holds {len(times_s)} times, but {poses} has {len(table.rows)} poses")
    return times_s, tuple(
        WORLD_FROM_FIRST_CAMERA @ rigid(poses, f"line {line}", row.reshape(3, 4), report)
        for line, row in zip(table.lines, table.rows, strict=True)
    )
