"""Everything that is wrong with a recording, its detections too: what `meshslam check` lists."""

from __future__ import annotations

from pathlib import Path

from meshslam.errors import SequenceError
from meshslam.perception import check_detections
from meshslam.sequences import LoadOptions, Problem, Report, Sequence, check_sequence, find_loader


def check_recording(
    path: Path | str,
    layout: str | None = None,
    camera_number: int | None = None,
    detections_path: Path | None = None,
) -> list[Problem]:
    """Problems and notes of all that a run would read, one each; an empty list means that nothing is wrong."""
    found, path = check_sequence(path, layout, camera_number, detections_path), Path(path)
    options = LoadOptions(camera_number, None if detections_path is None else Path(detections_path))
    report, sequence = Report(collect=True), _loaded(path, layout, options)
    file = options.detections_path or path / "detections.json"
    if options.detections_path is not None or file.is_file():
        check_detections(file, sequence, report)
    return [*found, *report.problems]


def _loaded(path: Path, layout: str | None, options: LoadOptions) -> Sequence | None:
    """The recording as far as it can be read; its problems are told elsewhere."""
    report = Report(collect=True)
    try:
        loader = find_loader(path, layout)
        return report.attempt(lambda: loader.load(path, options, report))
    except SequenceError:
        return None
