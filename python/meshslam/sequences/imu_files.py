"""IMU samples from a file of their own."""

from __future__ import annotations

from pathlib import Path

from meshslam.sequences.report import Report, fail
from meshslam.sequences.sequence import ImuSamples
from meshslam.sequences.text import check_increasing, read_csv

IMU_COLUMNS = ("timestamp", "wx", "wy", "wz", "ax", "ay", "az")


def read_imu(path: Path, report: Report) -> ImuSamples:
    """Read a CSV with the header timestamp,wx,wy,wz,ax,ay,az: seconds, rad/s, m/s² in the imu frame."""
    table = read_csv(path, IMU_COLUMNS, report)
    if not len(table.rows):
        raise fail(path, "", "holds no samples")
    check_increasing(path, table.rows[:, 0], table.lines, report)
    return ImuSamples(table.rows[:, 0], table.rows[:, 1:4], table.rows[:, 4:7])
