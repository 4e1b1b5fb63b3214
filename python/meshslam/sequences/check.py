"""Every problem of an input at once, for `meshslam check`."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from meshslam.errors import SequenceError
from meshslam.sequences.conventions import Convention
from meshslam.sequences.images import load_image
from meshslam.sequences.imu_files import with_imu
from meshslam.sequences.registry import find_loader, load_options
from meshslam.sequences.report import Problem, Report
from meshslam.sequences.sequence import ImuSamples, Sequence

LOWEST_IMU_RATE_HZ = 50.0  # below, preintegration between frames of 10 Hz has too few samples to work on
LONGEST_IMU_GAP = 5.0  # in sample periods


def check_sequence(
    path: Path | str,
    layout: str | None = None,
    camera_number: int | None = None,
    detections_path: Path | None = None,
) -> list[Problem]:
    """Look at everything that a run would read, every image too; an empty list means that nothing is wrong.

    Paths, calibration, times, poses, the IMU's rate and overlap, the images' sizes. Detections are checked elsewhere.
    """
    return inspect_sequence(path, layout, camera_number, detections_path)[1]


def inspect_sequence(
    path: Path | str,
    layout: str | None = None,
    camera_number: int | None = None,
    detections_path: Path | None = None,
    *,
    imu: Path | None = None,
    imu_from_camera: Path | None = None,
    poses_convention: Convention = "camera",
    camera_from_body: Path | None = None,
) -> tuple[Sequence | None, list[Problem]]:
    """The recording, if anything can be made of it, and the problems and notes of `check_sequence`."""
    path, report = Path(path), Report(collect=True)
    sequence = None
    try:
        loader = find_loader(path, layout)
        files = (detections_path, imu, imu_from_camera, poses_convention, camera_from_body)
        options = load_options(loader, path, camera_number, *files)
        sequence = report.attempt(lambda: loader.load(path, options, report))
        if sequence is not None and (imu is not None or imu_from_camera is not None):
            number = camera_number if loader.name == "folder" else None
            sequence = with_imu(sequence, imu, imu_from_camera, number)
    except SequenceError as error:
        return sequence, [*report.problems, Problem(path, "", str(error).removeprefix(f"{path}: "))]
    raw, bits = (None, None) if sequence is None else (sequence.raw_camera, sequence.image_bits)
    for image in report.attempt(lambda: loader.image_files(path, options)) or []:
        report.attempt(partial(load_image, image, None if raw is None else (raw.width, raw.height), bits))
    if sequence is not None:
        _check_imu(sequence, report)
    return sequence, report.problems


def _check_imu(sequence: Sequence, report: Report) -> None:
    if sequence.imu is None:
        return
    file = sequence.root / ("imu.csv" if sequence.layout == "folder" else "oxts")
    imu, first_s, last_s = sequence.imu, float(sequence.times_s[0]), float(sequence.times_s[-1])
    if imu.rate_hz < LOWEST_IMU_RATE_HZ and sequence.world_from_camera is None:
        report.add(
            file, "rate", f"{imu.rate_hz:.1f} Hz, at least {LOWEST_IMU_RATE_HZ:.0f} Hz are needed without known poses"
        )
    slack_s = 2 * _period_s(imu)
    begins, ends = float(imu.times_s[0]), float(imu.times_s[-1])
    if begins > first_s + slack_s or ends < last_s - slack_s:
        frames = f"do not cover the frames from {first_s:.3f} s to {last_s:.3f} s"
        report.add(file, "overlap", f"samples from {begins:.3f} s to {ends:.3f} s {frames}")
    for i in np.flatnonzero(np.diff(imu.times_s) > LONGEST_IMU_GAP * _period_s(imu)):
        report.add(file, "rate", f"no samples between {imu.times_s[i]:.3f} s and {imu.times_s[i + 1]:.3f} s")


def _period_s(imu: ImuSamples) -> float:
    return float(np.median(np.diff(imu.times_s))) if len(imu.times_s) > 1 else 0.0
