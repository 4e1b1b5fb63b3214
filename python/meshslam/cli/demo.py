"""`meshslam demo`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from meshslam.cli.options import AsJson, Overwrite

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from meshslam.viewing import ReportContext

RUNS = ("map", "localize", "slam")


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the recordings and the runs.")] = Path("demo"),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the street: the same seed gives the same bytes.")] = 0,
    overwrite: Overwrite = False,
    json: AsJson = False,
) -> None:
    """Draw a street, map its cars, find the camera in the map on a second drive, run SLAM; compare with the truth.

    Example: meshslam demo --out demo
    """
    from meshslam.cli.progress import run_outlet
    from meshslam.files import real_path
    from meshslam.runs import Config, InputConfig, run_localize, run_map, run_slam

    refuse_foreign(out)
    first, second = draw_drives(out, seed)
    drive = Config(InputConfig(sequence=str(first)))
    again = Config(InputConfig(sequence=str(second), map=str(real_path(out / "map"))))
    runs = {}
    for name, run, settings in (("map", run_map, drive), ("localize", run_localize, again), ("slam", run_slam, drive)):
        with run_outlet() as outlet:
            runs[name] = run(settings, out / name, outlet, overwrite=overwrite)
    show(runs, out, *pictures(out, first, second), as_json=json)


def draw_drives(out: Path, seed: int) -> tuple[Path, Path]:
    """Two drives through one street as sequence folders: masks without key points, poses for the first alone."""
    from meshslam.cli.progress import progress_bars
    from meshslam.files import real_path
    from meshslam.simulation import DEMO, EXACT, driven_again, make_world, write_recording

    first, second = (real_path(out) / f"street_{seed}{name}" for name in ("", "_again"))
    observer = replace(EXACT, keypoints=False)
    street = make_world(replace(DEMO, seed=seed))
    with progress_bars() as bars:
        write_recording(street, first, observer, bars)
    with progress_bars() as bars:
        write_recording(driven_again(street, DEMO.street), second, observer, bars, known_poses=False)
    return first, second


def pictures(out: Path, first: Path, second: Path) -> tuple[list[tuple[str, str]], tuple[str, ReportContext]]:
    """Captions and markup: a frame with the cars of the map, and both drives among them from above."""
    from meshslam.maps import Map, Trajectory
    from meshslam.perception import DetectionSet, read_detections
    from meshslam.sequences import open_sequence
    from meshslam.viewing import ReportContext, draw_overlay, jpeg_uri

    scene, drive, again = Map.load(out / "map"), open_sequence(first), open_sequence(second)
    paths = {name: Trajectory.load(out / name / "trajectory.tum") for name in ("map", "localize")}
    middle = len(drive) // 2
    seen = read_detections(out / "map" / "detections.json").by_frame().get(drive.frame_ids[middle], ())
    pose = paths["map"].world_from_camera[middle]
    bare = [replace(d, keypoints=None, keypoint_scores=None) for d in seen]
    frame = draw_overlay(drive.read_image(middle), drive.camera, pose, scene, bare)
    plan = ReportContext(
        title="",
        camera=again.camera,
        frame_ids=again.frame_ids,
        world_from_camera=paths["localize"].world_from_camera,
        times_s=paths["localize"].times_s,
        detections=DetectionSet((), (), ()),
        map=scene,
        other_paths={"path of the first drive": paths["map"].world_from_camera},
    )
    alternative = "a street with parked cars, each with its mesh drawn over it in a colour of its own"
    caption = (
        "A frame of the first drive: what was detected (boxes, masks with white borders), and the map's meshes with "
        "their numbers. What is grey was detected and is not in the map, because it moves or was seen too little."
    )
    return (
        [(caption, f'<img alt="{alternative}" src="{jpeg_uri(frame, 88)}">')],
        ("The map from above: the second drive as it was found in it, and the first.", plan),
    )


def show(
    runs: Mapping[str, Mapping[str, float]],
    out: Path,
    shown: Sequence[tuple[str, str]],
    plan: tuple[str, ReportContext],
    *,
    as_json: bool,
) -> None:
    """Print the figures of all runs, and write the page over them."""
    import json

    from rich.console import Console
    from rich.table import Table

    from meshslam.maps import write_atomically
    from meshslam.viewing import figure_rows, overview_page

    intro = (
        "A street that was drawn, seen by the shipped key point network and exact masks: mapped with known poses; "
        "found again on a second drive in that map, by IMU and detections; path and cars together without poses."
    )
    pages = {name: f"{name}/report.html" for name in runs}
    write_atomically(out / "report.html", overview_page("meshslam demo", intro, runs, pages, shown, plan).encode())
    if as_json:
        print(json.dumps(runs, indent=1))
        return
    table = Table("against truth", *runs, title=str(out))
    for label, cells in figure_rows(runs):
        table.add_row(label, *cells)
    Console().print(table)
    print(f"{out / 'report.html'}: open it in a browser")


def refuse_foreign(out: Path) -> None:
    """MapError if a folder holds anything but former demos."""
    from meshslam.errors import MapError

    if out.exists() and not out.is_dir():
        raise MapError(f"{out}: is a file, expected a folder to write the demo into: choose another --out")
    own = {*RUNS, "run", "report.html"}
    found = sorted(p.name for p in out.iterdir()) if out.exists() else []
    others = [name for name in found if not name.startswith("street_") and name not in own]
    if others:
        raise MapError(f"{out}: holds {', '.join(others[:3])}, which is no demo's: choose another --out")
