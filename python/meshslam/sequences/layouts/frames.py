"""A plain folder of frames, with the camera by --camera FILE."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshslam.geometry import Floats
from meshslam.sequences.cameras.read import read_camera
from meshslam.sequences.image_source import ImageFiles
from meshslam.sequences.images import (
    SUFFIXES,
    are_numbered,
    frame_numbers,
    image_bits,
    list_images,
    load_image,
    note_turn,
)
from meshslam.sequences.loader import LoadOptions
from meshslam.sequences.report import IncompleteError, Report, fail
from meshslam.sequences.sequence import Sequence
from meshslam.sequences.text import read_times
from meshslam.sequences.time_files import read_frame_times

USUAL_RATE_HZ = 10.0
_STAMP_DIGITS = 15  # of a name that is a time in microseconds or nanoseconds, no frame number
_SECONDS_OF_DIGITS = {16: 1e-6, 19: 1e-9}


@dataclass(frozen=True)
class Frames:
    """Times from times.txt in the folder or beside it, from names that are stamps, else by the given rate."""

    name: str = "frames"
    looks_for: str = "a folder of images"
    accepts: frozenset[str] = frozenset({"camera_file", "size", "rate_hz", "times_file"})

    def recognizes(self, path: Path) -> bool:
        """By the images in it."""
        return path.is_dir() and any(p.suffix.lower() in SUFFIXES for p in path.iterdir())

    def image_files(self, path: Path, options: LoadOptions) -> list[Path]:
        """Everything in the folder; see Loader."""
        return list_images(path)

    def load(self, path: Path, options: LoadOptions, report: Report) -> Sequence:
        """Read all but the images; see Loader."""
        files = report.attempt(lambda: self.image_files(path, options))
        if files is None:
            raise IncompleteError(f"{path}: nothing to load")
        if options.camera_file is None:
            raise fail(path, "", "a folder of frames says nothing of its camera: give --camera FILE (docs/cameras.md)")
        height, width = load_image(files[0]).shape[:2]
        given = options.camera_file
        found = read_camera(given, options.camera_number, options.size or (width, height), report)
        has_numbers = are_numbered(files) and not _are_stamps(files)
        frame_ids = frame_numbers(files) if has_numbers else tuple(range(len(files)))
        times_s = frame_times(path, files, frame_ids, options, report)
        note_turn(files, report)
        return Sequence(
            name=path.name,
            layout=self.name,
            root=path,
            camera=found.camera,
            frame_ids=frame_ids,
            times_s=times_s,
            images=ImageFiles(tuple(files), image_bits(files, report)),
            detections_path=options.detections_path,
            imu_from_camera=found.imu_from_camera,
            height_above_ground_m=found.height_above_ground_m,
            distortion=found.distortion,
        )


def _are_stamps(files: list[Path]) -> bool:
    return are_numbered(files) and len(files[0].stem) > _STAMP_DIGITS


def frame_times(
    path: Path, files: list[Path], frame_ids: tuple[int, ...], options: LoadOptions, report: Report
) -> Floats:
    """From --times FILE, times.txt, names that are stamps, else by the rate, which is said where none was given."""
    rate_hz = options.rate_hz
    if options.times_file is not None:
        return read_frame_times(options.times_file, len(files), path, report)
    for listed in (path / "times.txt", path.parent / "times.txt"):
        if rate_hz is None and listed.is_file():
            times_s = read_times(listed, report)
            if len(times_s) == len(files):
                return times_s
            if frame_ids[-1] < len(times_s):
                return times_s[list(frame_ids)]
            raise fail(listed, "", f"{len(times_s)} times, but {path.name} holds {len(files)} images")
    if rate_hz is None and _are_stamps(files):
        unit_s = _SECONDS_OF_DIGITS.get(len(files[0].stem))
        if unit_s is None:
            raise fail(files[0], "", "the name is no time in micro- or nanoseconds: give --rate HZ or --times FILE")
        return np.array([int(file.stem) for file in files]) * unit_s
    if rate_hz is None:
        report.note(
            path, "", f"no times: {USUAL_RATE_HZ:.0f} frames a second are taken: --rate HZ or --times FILE for others"
        )
    return np.array(frame_ids) / (rate_hz or USUAL_RATE_HZ)
