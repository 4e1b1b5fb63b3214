"""KITTI's OXTS recordings: one text file of 30 numbers a sample, and their timestamps."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from meshslam.geometry import Floats, Ints, Pose
from meshslam.sequences.report import Report, fail
from meshslam.sequences.sequence import ImuSamples
from meshslam.sequences.text import read_table, read_text

_STAMP = re.compile(r"\d{4}-\d\d-\d\d[ T]\d\d:\d\d:\d\d(\.\d{1,18})?", re.ASCII)
EARTH_RADIUS_M = 6378137.0
FIELDS = 30  # dataformat.txt
LATITUDE_DEG, LONGITUDE_DEG, ALTITUDE_M, ROLL, PITCH, YAW = range(6)
SPECIFIC_FORCE = slice(11, 14)  # ax, ay, az: along the imu's own axes (af, al, au are levelled)
ANGULAR_RATE = slice(17, 20)  # wx, wy, wz: likewise


@dataclass(frozen=True, eq=False)
class Oxts:
    """Samples of one recording."""

    numbers: tuple[int, ...]  # of the files
    times_ns: Ints  # (n,), on the recording's own clock
    rows: Floats  # (n, 30)


def read_timestamps(path: Path, report: Report) -> Ints:
    """Read lines like `2011-09-26 14:14:10.911916288` as nanoseconds (n,).

    KITTI has blank lines where a time is lost: they keep their place, and get the time between their neighbours'.
    """
    times, blank = [], []
    for number, line in enumerate(read_text(path).rstrip().splitlines(), 1):
        if not line.strip():
            blank.append(number - 1)
            continue
        try:
            if not _STAMP.fullmatch(line.strip()):
                raise ValueError(line)
            times.append(int(np.datetime64(line.strip().replace(" ", "T"), "ns").astype(np.int64)))
        except ValueError:
            raise fail(
                path, f"line {number}", f"expected a time like 2011-09-26 14:14:10.911916288, found {line[:60]!r}"
            ) from None
        if times[-1] < 0:
            raise fail(path, f"line {number}", f"no time: {line[:60]!r}")
    if not times:
        raise fail(path, "", "holds no times: the recording is empty")
    if blank:
        report.note(
            path, f"line {blank[0] + 1}", f"{len(blank)} blank lines: their times lie between their neighbours'"
        )
    return _with_blanks(np.array(times, np.int64), np.array(blank, np.int64))


def _with_blanks(times: Ints, blank: Ints) -> Ints:
    """Times (n,) with those at the indices `blank` of the whole between their neighbours, in even steps."""
    if not len(blank):
        return times
    whole = np.arange(len(times) + len(blank))
    given = np.setdiff1d(whole, blank)
    steps = np.interp(whole, given, (times - times[0]).astype(np.float64))
    if blank[0] < given[0] and len(given) > 1:
        before = whole < given[0]
        steps[before] = (whole[before] - given[0]) * float(times[1] - times[0]) / float(given[1] - given[0])
    found: Ints = times[0] + np.round(steps).astype(np.int64)
    found[given] = times
    return found


def read_oxts(folder: Path, report: Report) -> Oxts:
    """Read `folder`/data/*.txt with `folder`/timestamps.txt, whose line i + 1 belongs to file i."""
    times_ns = read_timestamps(folder / "timestamps.txt", report)
    files = sorted((folder / "data").glob("*.txt"))
    if not files:
        raise fail(folder / "data", "", "no such folder, or no samples (*.txt) in it")
    numbers, rows = [], []
    for file in files:
        if not (file.stem.isdigit() and int(file.stem) < len(times_ns)):
            report.add(folder / "timestamps.txt", "", f"{len(times_ns)} lines: none for {file.name}")
            continue
        table = report.attempt(partial(read_table, file, FIELDS, report))
        if table is not None and len(table.rows) == 1:
            numbers.append(int(file.stem))
            rows.append(table.rows[0])
        elif table is not None:
            report.add(file, "", f"expected one line of {FIELDS} numbers")
    if not rows:
        raise fail(folder / "data", "", "no sample can be read")
    return Oxts(tuple(numbers), times_ns[numbers], np.array(rows))


def world_from_imu(rows: Floats, origin: Floats) -> tuple[Pose, ...]:
    """Poses in the local east-north-up frame whose origin is the sample `origin` (30,).

    Mercator projection with the scale of the origin's latitude, as convertOxtsToPose.m of KITTI's development kit;
    unlike there the axes stay east, north, up.
    """
    from scipy.spatial.transform import Rotation  # slow to import

    positions = _mercator(rows, float(origin[LATITUDE_DEG])) - _mercator(origin[None], float(origin[LATITUDE_DEG]))
    rotations = Rotation.from_euler("ZYX", rows[:, [YAW, PITCH, ROLL]]).as_matrix()
    return tuple(Pose(r, p) for r, p in zip(rotations, positions, strict=True))


def _mercator(rows: Floats, origin_latitude_deg: float) -> Floats:
    scale = np.cos(np.radians(origin_latitude_deg)) * EARTH_RADIUS_M
    east = scale * np.radians(rows[:, LONGITUDE_DEG])
    north = scale * np.log(np.tan(np.radians(90 + rows[:, LATITUDE_DEG]) / 2))
    return np.stack([east, north, rows[:, ALTITUDE_M]], axis=1)


def imu_samples(oxts: Oxts, zero_ns: int) -> ImuSamples:
    """Angular rate and specific force along the imu's axes, times counted from `zero_ns`."""
    times_s = regular_times(seconds_from(oxts.times_ns, zero_ns))
    keep = np.concatenate([[True], times_s[1:] > np.maximum.accumulate(times_s)[:-1]])
    return ImuSamples(times_s[keep], oxts.rows[keep, ANGULAR_RATE], oxts.rows[keep, SPECIFIC_FORCE])


def seconds_from(times_ns: Ints, zero_ns: int) -> Floats:
    """Count nanoseconds (n,) in seconds from `zero_ns`; differences of nanoseconds fit a float."""
    seconds: Floats = (times_ns - zero_ns).astype(np.float64) * 1e-9
    return seconds


def regular_times(times_s: Floats, window: int = 101) -> Floats:
    """Put samples whose recorded time jumps back in line.

    The device samples evenly, but a few recorded times in a row can be late by tens of milliseconds, so that they go
    back afterwards. Time minus sample number times period is constant between gaps: what leaves its running median by
    more than half a period is set to it.
    """
    from scipy.ndimage import median_filter  # slow to import

    if len(times_s) < 3:
        return times_s
    index = np.arange(len(times_s))
    period = float(np.median(np.diff(times_s)))
    offset = times_s - period * index
    smooth = median_filter(offset, size=min(window, len(times_s) // 2 * 2 - 1), mode="nearest")
    return np.where(np.abs(offset - smooth) > period / 2, smooth + period * index, times_s)
