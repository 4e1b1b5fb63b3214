"""Every problem of an input at once, for `meshslam check`."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from meshslam.errors import SequenceError
from meshslam.sequences.image_source import ImageFiles, ImageSource
from meshslam.sequences.opening import RecordingOptions, load_options, opened
from meshslam.sequences.registry import find_loader
from meshslam.sequences.report import Problem, Report, late
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
    given = RecordingOptions(layout=layout, camera_number=camera_number, detections_path=detections_path)
    return inspect_sequence(Path(path), given)[1]


def inspect_sequence(path: Path, given: RecordingOptions) -> tuple[Sequence | None, list[Problem]]:
    """The recording, if anything can be made of it, and the problems and notes of `check_sequence`."""
    report, sequence = Report(collect=True, progress=given.progress), None
    try:
        loader = find_loader(path, given.layout)
        sequence = report.attempt(lambda: opened(loader, path, given, report))
    except SequenceError as error:
        return sequence, [*report.problems, Problem(path, "", str(error).removeprefix(f"{path}: "))]
    options = load_options(loader, path, given)
    images: ImageSource | None = None if sequence is None else sequence.images
    if sequence is None:
        files = report.attempt(lambda: loader.image_files(path, options))
        images = ImageFiles(tuple(files)) if files else None
    size = None if sequence is None else (sequence.raw_camera.width, sequence.raw_camera.height)
    if images is not None:
        progress = late(given.progress)
        for index in range(len(images)):
            report.attempt(partial(images.read, index, size))
            progress("images", index + 1, len(images))
    if sequence is not None:
        _check_imu(sequence, report)
    return sequence, report.problems


def _check_imu(sequence: Sequence, report: Report) -> None:
    if sequence.imu is None:
        return
    inside = {"folder": "imu.csv", "kitti-raw": "oxts"}.get(sequence.layout, "")
    file = sequence.root / inside
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
