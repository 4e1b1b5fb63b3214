"""What each step of a run costs: processor time, memory, bytes read and kept, by frames and cars."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from meshslam.fleet.drives import Drive, Needs
from meshslam.fleet.jobs import Job
from meshslam.fleet.work import thread_settings, work
from meshslam.runs import Config, overlaid

from .cases import Case, cases

Row = dict[str, Any]


def measured_steps(folder: Path) -> dict[str, list[Row]]:
    """Every step of every case, in one worker process as a fleet has them, of one CPU, warm."""
    os.environ.update(thread_settings(1))
    steps, runs = list[Row](), list[Row]()
    every = cases(folder)
    with ProcessPoolExecutor(1, get_context("spawn")) as worker:
        for command in ("map", "slam", "localize"):  # the first run of each loads what it uses
            warm = next(case for case in every if case.command == command and case.images is None)
            list(_steps_of(worker, warm, folder))
        list(_steps_of(worker, every[0], folder))
        for case in every:
            rows = list(_steps_of(worker, case, folder))
            figures = rows[-1].pop("figures")
            cars = figures.get("objects_mapped", figures.get("objects_in_map"))
            about = {"frames": figures["frames"], "cars": cars, "image_bytes": case.image_bytes}
            steps += [{**row, **about} for row in rows]
            runs.append({"case": case.name, "command": case.command, **about, **_kept(_out(folder, case))})
            print(f"  {case.name}:", *(f"{row['step']} {row['cpu_s']:.1f} s" for row in rows), flush=True)
    return {"steps": steps, "runs": runs}


def _out(folder: Path, case: Case) -> Path:
    return folder / "runs" / case.name.replace(" ", "_").replace("/", "_")


def _steps_of(worker: ProcessPoolExecutor, case: Case, folder: Path) -> Iterator[Row]:
    """A row for each step of a case that is run anew; the last has the run's figures."""
    out, name = _out(folder, case), case.name.replace(" ", "_").replace("/", "_")
    shutil.rmtree(out, ignore_errors=True)
    own = {"map": str(folder / "runs" / case.map_of.replace(" ", "_"))} if case.map_of else {}
    settings = overlaid(Config(), {"input": {**case.given, **own}}, case.name)
    drive, left = Drive(name, case.given["sequence"], case.command, settings), ["detect"]
    while left:
        job = Job(drive, left[0], Needs(), version("meshslam"), str(out))
        row, left, figures = worker.submit(_measured, job).result()
        yield {"case": case.name, "command": case.command, **row, **({} if left else {"figures": figures})}


def _measured(job: Job) -> tuple[Row, list[str], Any]:
    """In the worker: one step, with the processor's time of all its threads."""
    read, cpu_s, wall_s = _bytes_read(), time.process_time(), time.perf_counter()
    done = work(job, lambda *_: None)
    cpu_s, wall_s = time.process_time() - cpu_s, time.perf_counter() - wall_s
    if done.reason:
        raise RuntimeError(f"{job.drive.name}: {done.reason}")
    row = {
        "step": job.step,
        "cpu_s": round(cpu_s, 4),
        "wall_s": round(wall_s, 4),
        "peak_mb": done.peak_memory_mb,
        "read_bytes": _bytes_read() - read,
    }
    return row, list(done.left), done.figures


def _bytes_read() -> int:
    """By this process so far, from whatever: Linux tells."""
    return int(Path("/proc/self/io").read_text().split()[1])


def _kept(out: Path) -> Row:
    """Bytes and files of a run directory, and of its parts."""
    files = [path for path in out.rglob("*") if path.is_file()]
    size = {path.relative_to(out).as_posix(): path.stat().st_size for path in files}
    meshes = sum(count for name, count in size.items() if name.endswith(".ply"))
    return {
        "bytes": sum(size.values()),
        "files": len(size),
        "report_bytes": size.get("report.html", 0),
        "mesh_bytes": meshes,
    }
