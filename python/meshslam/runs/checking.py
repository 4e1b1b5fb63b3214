"""Everything that is wrong with a recording's detections: a part of what `meshslam check` lists."""

from __future__ import annotations

from pathlib import Path

from meshslam.perception import check_detections, renamings
from meshslam.sequences import Problem, Report, Sequence


def detection_problems(
    folder: Path, given: Path | None, recording: Sequence | None, names: tuple[str, ...] = ()
) -> list[Problem]:
    """Problems and notes of the detections that a run would read: the given ones, or the folder's own if there are any.

    `names` are classes that are others of ours, such as `vehicle=car`. `recording` is None where it cannot be read:
    frames and the images' size are not compared then.
    """
    file, report = given or folder / "detections.json", Report(collect=True)
    if given is not None or file.is_file():
        check_detections(file, recording, report, renamings(names))
    return report.problems
