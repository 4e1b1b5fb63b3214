"""Images that a list names with their times, as EuRoC's data.csv and TUM's rgb.txt do."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from meshslam.geometry import Floats
from meshslam.sequences.images import SUFFIXES
from meshslam.sequences.report import Report, fail
from meshslam.sequences.text import check_increasing, read_text


def timed_images(path: Path, folder: Path, separator: str | None, report: Report) -> tuple[Floats, list[Path]]:
    """Times as they stand in the list, and the images in `folder`; files of the list that are not there are left out.

    Lines that begin with # are skipped. FoundError if a line is none, times do not increase, or no image is there.
    """
    times, files, lines, missing = [], [], [], []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        words = [word.strip() for word in line.split(separator)]
        if not line.strip() or words[0].startswith("#"):
            continue
        file = folder / words[1] if len(words) == 2 else None
        if file is None or not _is_time(words[0]) or file.suffix.lower() not in SUFFIXES or ".." in file.parts:
            raise fail(path, f"line {number}", f"expected a time and an image's name, found {line.strip()[:60]!r}")
        if not file.is_file():
            missing.append(file.name)
            continue
        times.append(float(words[0]))
        files.append(file)
        lines.append(number)
    if not files:
        raise fail(path, "", f"none of its images is in {folder}" if missing else "names no images: it is empty")
    if missing:
        report.note(path, "", f"{len(missing)} of its images are not there and left out, the first {missing[0]}")
    check_increasing(path, np.array(times), tuple(lines), report)
    return np.array(times), files


def _is_time(word: str) -> bool:
    try:
        return bool(0 <= float(word) < 1e20)
    except ValueError:
        return False
