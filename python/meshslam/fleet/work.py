"""What a worker does with a job: the step of the run, by the code of a single run."""

from __future__ import annotations

import socket
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from meshslam.errors import MapError, MeshslamError
from meshslam.files import LOCK, wait_until_free
from meshslam.fleet.carried import changes_of, put_files
from meshslam.fleet.drives import Drive
from meshslam.fleet.jobs import Job, Outcome
from meshslam.fleet.urls import downloaded, is_url

if TYPE_CHECKING:
    from meshslam.runs import Outlet, Step

Progress = Callable[[str, int, int], None]
_RESET_PEAK = "5"  # to /proc/self/clear_refs: see proc(5)


def work(job: Job, progress: Progress) -> Outcome:
    """Do a job. Whatever goes wrong with the drive becomes the outcome's reason; Ctrl-C alone is raised."""
    began_s = time.perf_counter()
    _forget_peak()
    try:
        done = _refused(job) or _done(job, progress)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # SystemExit, too: it would end the worker, and Ray would begin the drive again
        done = Outcome(reason=reason_of(error), fault=_fault_of(error))
    return replace(
        done, seconds=time.perf_counter() - began_s, peak_memory_mb=_peak_memory_mb(), node=socket.gethostname()
    )


def thread_settings(threads: int) -> dict[str, str]:
    """Environment of a worker: engines, machines and Ray set other numbers of threads, or none."""
    count = str(threads)
    return {"OMP_NUM_THREADS": count, "OPENBLAS_NUM_THREADS": "1", "RAYON_NUM_THREADS": count}


def reason_of(error: BaseException) -> str:
    """What went wrong, in one line."""
    if isinstance(error, MeshslamError):
        return str(error)
    if isinstance(error, OSError):
        return f"{error.filename or ''}: {error.strerror or error}".removeprefix(": ")
    if isinstance(error, MemoryError):
        return "out of memory: give fewer frames, or lower objects.max_views in the settings"
    return f"{type(error).__name__}: {' '.join(str(error).split())[:300]}: a fault of meshslam: please report it"


def _fault_of(error: BaseException) -> str:
    if isinstance(error, MeshslamError | OSError | MemoryError):
        return ""
    return "".join(traceback.format_exception(error))


def _refused(job: Job) -> Outcome | None:
    """The reason if this machine has another version than the one that sent the job."""
    here = version("meshslam")
    if here == job.version:
        return None
    return Outcome(reason=f"{socket.gethostname()} has meshslam {here}, the fleet is run by {job.version}: install one")


def _done(job: Job, progress: Progress) -> Outcome:
    """The step in its run directory, with the recording at hand."""
    from meshslam.runs import Outlet

    with _recording(job.drive) as drive, _run_folder(job) as out:
        outlet = Outlet(progress)
        step = _step(job, drive, out, outlet)
        changes = {} if job.out is not None else changes_of(out, job.files)
    return Outcome(step.left, step.figures, tuple(outlet.notes), step.was_there, changes=changes)


def _step(job: Job, drive: Drive, out: Path, outlet: Outlet) -> Step:
    """The step; with `overwrite` a run of other settings or input is replaced, one that is as it should be is not."""
    from meshslam.runs import run_step

    given = (job.step, drive.command, drive.settings, out, outlet)
    try:
        return run_step(*given, overwrite=False)
    except MapError:
        if not job.overwrite:
            raise
        return run_step(*given, overwrite=True)


@contextmanager
def _recording(drive: Drive) -> Iterator[Drive]:
    """The drive with a recording that is a path: a URL's is downloaded while the block runs."""
    if not is_url(drive.recording):
        yield drive
        return
    with downloaded(drive.recording, drive.name) as place:
        chosen = replace(drive.settings.input, sequence=str(place))
        yield replace(drive, settings=replace(drive.settings, input=chosen))


@contextmanager
def _run_folder(job: Job) -> Iterator[Path]:
    """The run directory; where none is shared, one of its own for the block, with the files that are there already."""
    if job.out is not None:
        out = Path(job.out)
        wait_until_free(out / LOCK)  # a worker before this one may still be dying
        yield out
        return
    with TemporaryDirectory(prefix="meshslam-fleet-") as folder:
        out = Path(folder) / job.drive.name
        put_files(out, job.files)
        yield out


def _peak_memory_mb() -> float:
    from meshslam.runs import peak_memory_mb

    return round(peak_memory_mb(), 1)


def _forget_peak() -> None:
    """Let the worker's peak of memory be this job's: Linux can, elsewhere it is the largest of its jobs."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text(_RESET_PEAK, encoding="ascii")
