"""A fleet from its file to its summary."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from meshslam.errors import ConfigError, MapError
from meshslam.files import LOCK, locked, real_path
from meshslam.fleet.drives import Fleet
from meshslam.fleet.engine import Engine
from meshslam.fleet.places import Folder, Place, Url
from meshslam.fleet.results import DriveResult, failures_first
from meshslam.fleet.scheduling import RETRIES, Schedule, Watch
from meshslam.fleet.summary import save_summary
from meshslam.fleet.urls import is_url


def place_of(out: str, *, shared: bool) -> Place:
    """Where results go: a folder that all machines share, one of the driver alone, or a URL that fsspec writes."""
    return Url(out) if is_url(out) else Folder(real_path(out), shared)


def engine_of(name: str, address: str | None, workers: int | None) -> Engine:
    """An engine by its name; ConfigError if it cannot be had."""
    if name == "ray":
        from meshslam.fleet.cluster import Cluster

        return Cluster.connect(address, workers)
    if name != "local":
        raise ConfigError(f"--engine {name}: there are local and ray")
    if address is not None:
        raise ConfigError("--address is that of a Ray cluster: give --engine ray, too")
    from meshslam.fleet.processes import Processes

    return Processes(workers)


def run_fleet(
    fleet: Fleet,
    place: Place,
    engine: Callable[[], Engine],
    *,
    retries: int = RETRIES,
    overwrite: bool = False,
    watch: Watch | None = None,
) -> list[DriveResult]:
    """Run every drive of a fleet and write the summary; the results are failures first.

    A drive's folder holds what a single run writes, to the same bytes. What is there already is not done again.
    `engine` makes the engine, which is closed whatever ends the run. Drives fail alone: a result tells the reason.
    """
    with _alone(place):
        running = engine()
        schedule = Schedule(fleet, place, running, retries, overwrite, watch or Watch())
        try:
            schedule.run()
        finally:
            running.close()
            save_summary(failures_first(schedule.results()), fleet, place)
    return failures_first(schedule.results())


@contextmanager
def _alone(place: Place) -> Iterator[None]:
    """No other fleet in the folder while the block runs."""
    if not isinstance(place, Folder):
        yield
        return
    folder = Path(place.folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise MapError(f"{folder}: cannot be written: {problem.strerror}") from None
    with locked(folder / LOCK, str(folder)):
        yield
