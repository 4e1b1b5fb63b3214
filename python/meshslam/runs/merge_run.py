"""`merge`: from the folders of several runs to one map."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from meshslam.categories import Category, load_category
from meshslam.errors import MapError, MeshslamError
from meshslam.files import LOCK, locked, real_path, replaced_folder, write_into
from meshslam.maps import Trajectory
from meshslam.merging import Merged, World, drives_json, merge_drives, read_drives, visits_json
from meshslam.runs.clock import Clock
from meshslam.runs.config import Config
from meshslam.runs.evaluating import recording_of
from meshslam.runs.outlet import Outlet
from meshslam.runs.settings import to_yaml
from meshslam.runs.stages import metrics_json
from meshslam.viewing import merge_page

DRIVES = "drives.json"  # by it a merged folder is known


def merge_runs(folders: Sequence[Path], settings: Config, outlet: Outlet, *, allow_outside: bool = False) -> Merged:
    """Merge the runs of folders in memory; errors as for `read_drives` and `merge_drives`."""
    if len(folders) < 2:
        raise MapError(f"{folders[0] if folders else 'merge'}: merging needs two runs or more")
    drives, missing = read_drives(folders, allow_outside=allow_outside)
    for note in missing:
        outlet.note(note)
    categories = _categories(folders)
    merged = merge_drives(drives, settings.merging, settings.objects, categories=categories, progress=outlet.progress)
    for note in merged.notes:
        outlet.note(note)
    return merged


def run_merge(
    folders: Sequence[Path],
    settings: Config,
    out: Path,
    outlet: Outlet,
    *,
    overwrite: bool,
    allow_outside: bool = False,
    clock: Clock | None = None,
) -> dict[str, float]:
    """Merge, and write the folder `out`, which is whole or not there; MapError if another thing is there."""
    clock, place = clock or Clock(), real_path(out)
    if any(place == real_path(folder) or place in real_path(folder).parents for folder in folders):
        raise MapError(f"{out}: holds a run that is to be merged: choose another --out")
    _check(out, overwrite=overwrite)
    with clock.timing("merging"):
        merged = merge_runs(folders, settings, outlet, allow_outside=allow_outside)
    frames = sum(len(drive.trajectory or ()) for drive in merged.drives)
    figures = {**merged.figures, "frames": frames, **clock.figures(frames)}
    place.parent.mkdir(parents=True, exist_ok=True)
    with (
        locked(place.with_name(f".{place.name}{LOCK}"), str(out)),
        replaced_folder(place, (), _checker(out, overwrite=overwrite), MapError) as part,
    ):
        _write(merged, merged.worlds[0], part)
        for k, world in enumerate(merged.worlds[1:], 2):
            _write(merged, world, part / f"world-{k}")
        write_into(part / "config.yaml", to_yaml(settings, "merge"), MapError)
        write_into(part / "metrics.json", metrics_json(figures, outlet.notes), MapError)
    return figures


def _write(merged: Merged, world: World, folder: Path) -> None:
    """One world's files."""
    folder.mkdir(parents=True, exist_ok=True)
    world.standing.save(folder)
    if len(world.gone):
        world.gone.save(folder / "gone")
    paths: Mapping[str, Trajectory] = merged.trajectories_in(world)
    (folder / "trajectories").mkdir(exist_ok=True)
    for name, path in paths.items():
        write_into(folder / "trajectories" / f"{name.replace('/', '_')}.tum", path.to_tum(), MapError)
    write_into(folder / "visits.json", visits_json(merged, world), MapError)
    write_into(folder / DRIVES, drives_json(merged, world), MapError)
    write_into(folder / "merge.html", merge_page(merged, world), MapError)


def _categories(folders: Sequence[Path]) -> dict[str, Category]:
    """The categories that runs were made with and that are files, by name."""
    found = {}
    for folder in folders:
        chosen = recording_of(folder)
        if chosen is not None and chosen.category.endswith(".npz"):
            try:
                category = load_category(chosen.category)
            except MeshslamError:
                continue  # its cars are fused by their figures
            found[category.name] = category
    return found


def _checker(out: Path, *, overwrite: bool) -> Callable[[], None]:
    return lambda: _check(out, overwrite=overwrite)


def _check(out: Path, *, overwrite: bool) -> None:
    """MapError for a place that holds something which must stay."""
    if not out.exists() or (out.is_dir() and not any(out.iterdir())):
        return
    if not (out / DRIVES).is_file():
        raise MapError(f"{out}: holds something that is no merged map: choose another --out")
    if not overwrite:
        raise MapError(f"{out}: a merged map is there already: give --overwrite, or another --out")
