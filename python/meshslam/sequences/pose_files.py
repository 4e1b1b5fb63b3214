"""Camera poses from a file of their own, for any recording: TUM, EuRoC, VINS, KITTI, COLMAP's images.txt."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.sequences.colmap_images import by_file_name, is_colmap_images, read_colmap_images
from meshslam.sequences.conventions import WORLD_FROM_FIRST_CAMERA
from meshslam.sequences.loader import LoadOptions
from meshslam.sequences.pose_matching import all_or_some, poses_at
from meshslam.sequences.report import Report, fail
from meshslam.sequences.sequence import Sequence
from meshslam.sequences.text import parse_table, read_table, read_text, rigid
from meshslam.sequences.tum import poses_of_rows, read_tum

_NANOSECONDS = 1e5  # steps between poses, or 1e14 as a single time, that are no seconds
_EUROC_COLUMNS = 8  # time, x, y, z, then the quaternion with w first; EuRoC and VINS write more behind


def with_poses(sequence: Sequence, path: Path, options: LoadOptions, time_offset_s: float, report: Report) -> Sequence:
    """The recording with the poses of a file, in place of its own.

    Read are TUM's eight numbers (ORB-SLAM3 and evo write them too; nanoseconds are told by their size), EuRoC's and
    VINS' comma-separated lines with w first, KITTI's twelve numbers a line and frame, and COLMAP's images.txt or
    images.bin, whose names are the images'. `options` say the convention; the clock of the poses is `time_offset_s`
    ahead of the frames'.
    """
    if is_colmap_images(path):
        return _placed(sequence, _colmap(sequence, path, report), False)
    lines = [text for line in read_text(path).splitlines() if (text := line.strip()) and text[0] != "#"]
    if not lines:
        raise fail(path, "", "holds no poses")
    words = re.split(r"[,\s]+", lines[0].strip(", "))
    if len(words) == 12 and "," not in lines[0]:
        return _placed(sequence, _kitti(sequence, path, report), False)
    if "," in lines[0]:
        times_s, poses = read_euroc(path, report)
    elif len(words) == 8:
        times_s, poses = read_tum_times(path, report)
    else:
        raise fail(path, "", f"expected TUM (8 numbers a line), KITTI (12), EuRoC or VINS (CSV), found {len(words)}")
    there = poses_at(sequence.times_s, times_s - time_offset_s, options.world_from_camera(poses), path, report)
    return _placed(sequence, there, options.poses_convention != "first-camera-world")


def _placed(sequence: Sequence, poses: Mapping[int, Pose], is_levelled: bool) -> Sequence:
    every, some = all_or_some(poses, len(sequence))
    return replace(sequence, world_from_camera=every, partial_poses=some, is_levelled=is_levelled)


def _kitti(sequence: Sequence, path: Path, report: Report) -> dict[int, Pose]:
    """By frame number, or by frame where there is a line for each frame of the recording alone."""
    table = read_table(path, 12, report, by_line=True)
    last = sequence.frame_ids[-1]
    if last < len(table.rows):
        rows = list(sequence.frame_ids)
    elif len(table.rows) == len(sequence):
        rows = list(range(len(sequence)))
    else:
        raise fail(path, "", f"{len(table.rows)} poses for {len(sequence)} frames, the last of number {last}")
    read = partial(_kitti_pose, path, report)
    return {i: WORLD_FROM_FIRST_CAMERA @ read(table.lines[k], table.rows[k]) for i, k in enumerate(rows)}


def _kitti_pose(path: Path, report: Report, line: int, row: Floats) -> Pose:
    return rigid(path, f"line {line}", row.reshape(3, 4), report)


def read_tum_times(path: Path, report: Report) -> tuple[Floats, tuple[Pose, ...]]:
    """Times (n,) in seconds and poses of a TUM file; nanoseconds are told by their size."""
    times_s, poses = read_tum(path, report)
    return _in_seconds(times_s, path, report), poses


def read_euroc(path: Path, report: Report) -> tuple[Floats, tuple[Pose, ...]]:
    """Times (n,) in seconds and poses from lines `time, x, y, z, qw, qx, qy, qz`; what comes behind is left out."""
    lines = enumerate(read_text(path).splitlines(), 1)
    rows = [(n, re.split(r"[,\s]+", line.strip().strip(","))) for n, line in lines]
    words = [(n, row[:_EUROC_COLUMNS]) for n, row in rows if _is_number(row[0])]
    table = parse_table(path, words, _EUROC_COLUMNS, report)
    if not len(table.rows):
        raise fail(path, "", "holds no poses: expected time, x, y, z, qw, qx, qy, qz a line")
    ordered = table.rows[:, [0, 1, 2, 3, 5, 6, 7, 4]]
    times_s, poses = poses_of_rows(path, ordered, table.lines, report)
    return (times_s / 1e9 if _are_nanoseconds(times_s) else times_s), poses


def _in_seconds(times: Floats, path: Path, report: Report) -> Floats:
    if not _are_nanoseconds(times):
        return times
    report.note(path, "", "times are nanoseconds: taken as such")
    return times / 1e9


def _are_nanoseconds(times: Floats) -> bool:
    step = float(np.median(np.diff(times))) if len(times) > 1 else float(times[0]) / 1e9
    return step >= _NANOSECONDS


def _colmap(sequence: Sequence, path: Path, report: Report) -> dict[int, Pose]:
    if sequence.images is None:
        raise fail(path, "", "COLMAP's poses go by the images' names, but the recording has no images")
    placed = by_file_name(path, read_colmap_images(path))
    names = sequence.images.names
    found = {i: WORLD_FROM_FIRST_CAMERA @ placed[n][0].inverse() for i, n in enumerate(names) if n in placed}
    if not found:
        raise fail(path, "", f"no image of it is one of the recording's, such as {names[0]}")
    if len(found) < len(sequence):
        missing = len(sequence) - len(found)
        report.note(path, "", f"{missing} of {len(sequence)} frames have no pose: map leaves them out")
    return found


def _is_number(word: str) -> bool:
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False
