"""What the fleet's driver costs for each task: its own code, Ray's calls, and worker processes."""

from __future__ import annotations

import os
import secrets
import shutil
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import yaml

from meshslam.fleet import Fleet, Folder, read_fleet
from meshslam.fleet.cluster import Cluster
from meshslam.fleet.drives import Drive, Needs
from meshslam.fleet.jobs import Job, Outcome, Running
from meshslam.fleet.processes import Processes
from meshslam.fleet.ray_losses import result_of
from meshslam.fleet.scheduling import Schedule
from meshslam.fleet.summary import save_summary
from meshslam.runs import Config

OWN = ((1_000, 20), (10_000, 200), (10_000, 2_000), (100_000, 2_000), (100_000, 16_000))  # drives, CPUs
WAITING = (1, 100, 1000, 2000, 4000)
ROWS = (0, 1000, 4000)
LEFT = {"detect": ("track", "map"), "track": ("map",), "map": ()}


def measured_driver(folder: Path, tiny: Callable[[Path], Job]) -> dict[str, Any]:
    """Seconds: of the driver's thread, and of empty tasks by both engines. `tiny` is a small real job."""
    return {
        "own": [{"drives": drives, "cpus": cpus, "task_s": own_task_s(drives, cpus)} for drives, cpus in OWN],
        **of_file_and_summary(folder, 2000),
        **of_processes(folder, tiny),
        **of_ray(),
    }


class NoRay:
    """As the module `ray`: the task that was submitted first ends, one at a time, and nothing is done."""

    def __init__(self, cpus: float) -> None:
        self.cpus, self.jobs, self.count = cpus, dict[int, Job](), 0
        self.exceptions = SimpleNamespace(
            **dict.fromkeys(("OutOfMemoryError", "RayTaskError", "RuntimeEnvSetupError", "NodeDiedError"), KeyError)
        )

    def remote(self, _function: object) -> SimpleNamespace:
        return SimpleNamespace(options=lambda **_options: SimpleNamespace(remote=self._submit))

    def _submit(self, job: Job, *_more: object) -> int:
        self.count += 1
        self.jobs[self.count] = job
        return self.count

    def nodes(self) -> list[dict[str, Any]]:
        return [{"Alive": True, "Resources": {"CPU": self.cpus}}]

    def wait(self, references: list[int], num_returns: int, timeout: float) -> tuple[list[int], list[int]]:
        return [next(iter(self.jobs))], []

    def get(self, reference: int, timeout: float | None = None) -> Outcome:
        return Outcome(left=LEFT[self.jobs.pop(reference).step], figures={"objects_mapped": 1.0})


def drives_of(count: int) -> tuple[Drive, ...]:
    """Drives that nobody opens."""
    settings = Config()
    return tuple(Drive(f"drive_{k:06d}", f"drives/{k}", "map", settings) for k in range(count))


def own_task_s(drives: int, cpus: int, tasks: int = 3000) -> float:
    """Processor time of scheduler and engine for a task, while so many drives wait and as many are under way as fit."""
    ray = NoRay(cpus)
    schedule = Schedule(
        Fleet(Path("fleet.yaml"), drives_of(drives)), Folder(Path("out")), Cluster(None, ray, None), now_s=lambda: 0.0
    )
    schedule._begin()
    began_s, before = time.process_time(), ray.count
    while ray.count - before < tasks and schedule.waiting:
        for ended in schedule.engine.ended(0.5):
            schedule._take(ended)
        schedule._begin()
    return (time.process_time() - began_s) / (ray.count - before)


def of_file_and_summary(folder: Path, count: int) -> dict[str, float]:
    """Reading the fleet file, and writing the summary, for each drive."""
    file = folder / "many.yaml"
    listed = [
        {"name": f"d{k}", "recording": f"drives/{k}", "settings": {"input": {"rate_hz": 10}}} for k in range(count)
    ]
    file.write_text(yaml.safe_dump({"drives": listed}))
    began_s = time.process_time()
    fleet = read_fleet(file)
    read_s = time.process_time() - began_s
    schedule = Schedule(fleet, Folder(folder / "many"), Cluster(None, NoRay(2000), None))
    while schedule.waiting or schedule.under_way:
        schedule._begin()
        for ended in schedule.engine.ended(0.5):
            schedule._take(ended)
    results = schedule.results()
    began_s = time.process_time()
    save_summary(results, fleet, schedule.place)
    return {"read_drive_s": read_s / count, "summary_drive_s": (time.process_time() - began_s) / count}


def refused(count: int) -> Schedule:
    """A schedule whose tasks end at once, as their version is another."""
    return Schedule(Fleet(Path("fleet.yaml"), drives_of(count)), Folder(Path("out")), None, _version="none")  # type: ignore[arg-type]


def run_empty(schedule: Schedule, engine: Any) -> tuple[float, float]:
    """Wall and processor seconds of the driver for each drive's one task."""
    schedule.engine = engine
    began = time.perf_counter(), time.process_time()
    schedule.run()
    return tuple((b - a) / len(schedule.states) for a, b in zip(began, _clocks(), strict=True))  # type: ignore[return-value]


def _clocks() -> tuple[float, float]:
    return time.perf_counter(), time.process_time()


def of_processes(folder: Path, tiny: Callable[[Path], Job]) -> dict[str, float]:
    """Empty tasks in two processes, and what the first task of a process costs more than its second."""
    engine = Processes(2)
    try:
        run_empty(refused(50), engine)
        wall_s, cpu_s = run_empty(refused(2000), engine)
    finally:
        engine.close()
    starts = [_start_s(folder / f"start{k}", tiny) for k in range(3)]
    return {"local_task_s": wall_s, "local_driver_s": cpu_s, "worker_start_s": min(starts)}


def _start_s(folder: Path, tiny: Callable[[Path], Job]) -> float:
    shutil.rmtree(folder, ignore_errors=True)
    engine, took_s = Processes(1), []
    try:
        for name in ("cold", "warm"):
            began_s = time.perf_counter()
            engine.submit(tiny(folder / name))
            while not engine.ended(1.0):
                pass
            took_s.append(time.perf_counter() - began_s)
    finally:
        engine.close()
    return took_s[0] - took_s[1]


def of_ray() -> dict[str, Any]:
    """Calls of Ray's driver: the least of several, as other programs may run."""
    os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_hex(32))
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    engine = Cluster.connect(None, 2)
    ray: Any = engine._ray
    try:
        run_empty(refused(100), engine)
        wall_s, cpu_s = run_empty(refused(2000), engine)
        engine.workers = 10**6
        found = {"ray_task_s": wall_s, "ray_driver_s": cpu_s, **_submit_and_get(engine, ray, 2000)}
        waiting = {count: _wait_s(ray, count) for count in WAITING}
        board = {count: _board_s(engine, count) for count in ROWS}
    finally:
        engine.close()
    found |= dict(zip(("ray_wait_reference_s", "ray_wait_s"), _line(waiting), strict=True))
    found |= dict(zip(("ray_board_row_s", "ray_board_s"), _line(board), strict=True))
    return {**found, "ray": version("ray"), "ray_waits": list(waiting.items()), "ray_boards": list(board.items())}


def _submit_and_get(engine: Cluster, ray: Any, count: int) -> dict[str, float]:  # the module
    jobs = [Job(drive, "detect", Needs(), "none") for drive in drives_of(count)]
    submits = np.array([_took_s(engine.submit, job) for job in jobs])
    references = list(engine._under_way)
    ray.wait(references, num_returns=count)
    gets = np.array([_took_s(result_of, ray, reference) for reference in references])
    for reference in references:
        engine._gone(reference)
    return {"ray_submit_s": float(np.median(submits)), "ray_get_s": float(np.median(gets))}


def _took_s(work: Callable[..., object], *arguments: object) -> float:
    began_s = time.perf_counter()
    work(*arguments)
    return time.perf_counter() - began_s


def _wait_s(ray: Any, count: int) -> float:  # the module
    """Both waits of a look for tasks that have ended, while so many are under way and one has ended."""
    ready, function = ray.put(1), ray.remote(_nothing)
    under_way = [function.options(num_cpus=64).remote() for _ in range(count)]  # that no node takes
    references = [*under_way, ready]

    def look() -> None:
        ray.wait(references, num_returns=1, timeout=1.0)
        ray.wait(references, num_returns=len(references), timeout=0.0)

    least = min(_took_s(look) for _ in range(7))
    for reference in under_way:
        ray.cancel(reference, force=True)
    return least


def _nothing() -> None:
    return


def _board_s(engine: Cluster, count: int) -> float:
    """Asking how far so many tasks are."""
    for drive in drives_of(count):
        engine._under_way[drive.name] = Job(drive, "detect", Needs(), "none")
        engine._board.tell.remote(Running(drive.name, "detect", "segment", 5, 100))
    least = min(_took_s(engine.running) for _ in range(7))
    engine._under_way.clear()
    return least


def _line(points: dict[int, float]) -> Sequence[float]:
    """Slope and what is fixed."""
    slope, fixed = np.polyfit(list(points), list(points.values()), 1)
    return float(slope), max(0.0, float(fixed))
