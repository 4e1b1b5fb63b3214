"""`meshslam evaluate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from meshslam.evaluation import Material, Measured


def evaluate(
    run: Annotated[
        Path | None, typer.Argument(help="Folder of a run: map.json, trajectory.tum, detections.json.")
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option(
            help="The recording with its truth, a file of poses (TUM, EuRoC, KITTI), or objects.json. Without it: the "
            "recording that the run's config.yaml names."
        ),
    ] = None,
    trajectory: Annotated[
        Path | None, typer.Option(help="A file of poses (TUM, EuRoC, KITTI) to measure, of any program.")
    ] = None,
    times: Annotated[Path | None, typer.Option(help="Times of KITTI's poses, one a line.")] = None,
    protocol: Annotated[
        list[str] | None,
        typer.Option(help="A protocol or group, again for more; all without it. docs/evaluation.md lists them."),
    ] = None,
    align: Annotated[
        bool, typer.Option("--align", help="Lay map and path on the truth by the poses (SE(3)) before all else.")
    ] = False,
    rpe_frames: Annotated[int, typer.Option(min=1, help="Frames that rpe-frames measures over.")] = 1,
    rpe_metres: Annotated[float, typer.Option(min=0.01, help="Metres that rpe-metres measures over.")] = 10.0,
    max_difference: Annotated[
        float, typer.Option(min=0.0, help="Seconds between a true and an estimated pose of one time.")
    ] = 0.005,
    out: Annotated[
        list[Path] | None, typer.Option(help="File to write, again for more: .csv, .json, .md or .tex.")
    ] = None,
    allow_outside: Annotated[
        bool, typer.Option(help="Read meshes of the maps that are outside their folders.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")] = False,
) -> None:
    """Measure a run, or a path of any program, against truth, by protocols that have names.

    What cannot be computed is listed with the reason. Exit code 3: nothing could be computed.

    Example: meshslam evaluate run --truth drive

    Example: meshslam evaluate --trajectory estimate.tum --truth groundtruth.tum --protocol ate-se3

    Example: meshslam evaluate run --truth drive --protocol objects --out table.tex --out figures.csv
    """
    from meshslam.errors import MapError, SequenceError
    from meshslam.files import must_exist

    for path, what in ((run, "run directory"), (trajectory, "file with poses")):
        if path is not None:
            must_exist(path, what, MapError)
    for path, what in ((truth, "truth"), (times, "file with times")):
        if path is not None:
            must_exist(path, what, SequenceError)
    files = _checked(out or [])
    from meshslam.cli.figures import end_without
    from meshslam.cli.progress import progress_bars
    from meshslam.evaluation import Options, chosen_protocols, formatted, measure
    from meshslam.maps import write_atomically
    from meshslam.runs import Measurable, read_material

    chosen_protocols(protocol or [])
    given = Measurable(run, trajectory, truth, times, allow_outside)
    material, notes = read_material(given, Options(max_difference, rpe_frames, rpe_metres))
    with progress_bars() as bars:
        rows = measure(material.aligned() if align else material, protocol or [], bars)
    about = _about(given, material, notes, align=align)
    for file in files:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(file, formatted(file.suffix, rows, about).encode())
    if json:
        print(formatted(".json", rows, about), end="")
    else:
        _show(rows, about)
    end_without(sum(len(row.figures) for row in rows))


def _checked(files: list[Path]) -> list[Path]:
    """The files, whose endings are known; ConfigError for another."""
    from meshslam.errors import ConfigError

    known = (".csv", ".json", ".md", ".tex")
    for file in files:
        if file.suffix not in known:
            raise ConfigError(f"--out {file}: its ending says the format: {', '.join(known)}")
    return files


def _about(given: Any, material: Material, notes: tuple[str, ...], *, align: bool) -> dict[str, Any]:  # noqa: ANN401
    """What was measured, and how."""
    from meshslam.evaluation import UnavailableError

    try:
        pair = material.pair()
        poses = {"matched": len(pair), "only_in_truth": pair.unmatched_truth}
        poses["only_in_estimate"] = pair.unmatched_estimates
    except UnavailableError:
        poses = {}
    options = material.options
    return {
        "run": None if given.run is None else str(given.run),
        "trajectory": None if given.trajectory is None else str(given.trajectory),
        "truth": None if given.truth is None else str(given.truth),
        "options": {
            "align": align,
            "max_difference_s": options.max_difference_s,
            "rpe_frames": options.rpe_frames,
            "rpe_metres": options.rpe_metres,
        },
        "poses": poses,
        "notes": list(notes),
    }


def _show(rows: Sequence[Measured], about: Mapping[str, Any]) -> None:
    """Print a table, what was not computed, and how poses were paired."""
    import sys

    from rich.console import Console
    from rich.table import Table

    from meshslam.evaluation import ARROWS, short
    from meshslam.viewing import better_of

    for note in about["notes"]:
        print(f"note: {note}", file=sys.stderr)
    table = Table("protocol", "figure", "value", "better", title=str(about["run"] or about["trajectory"]))
    for row in rows:
        for place, (key, value) in enumerate(row.figures.items()):
            last = place == len(row.figures) - 1
            name = "" if place else row.protocol
            table.add_row(name, key, short(value), ARROWS[better_of(key)], end_section=last)
    if table.row_count:
        Console().print(table)
    poses = about["poses"]
    if poses:
        within = f"within {about['options']['max_difference_s']:g} s"
        print(
            f"poses: {poses['matched']} paired {within}; without a partner: {poses['only_in_truth']} true, "
            f"{poses['only_in_estimate']} estimated"
        )
    left = [row for row in rows if row.reason is not None]
    if left:
        print("not computed:")
    for row in left:
        print(f"  {row.protocol}: {row.reason}")
