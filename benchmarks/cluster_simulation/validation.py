"""The simulation against reality: small drives in two workers of this machine, by the local engine and by Ray."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from meshslam.fleet import DriveResult, Fleet, Folder, engine_of
from meshslam.fleet.drives import Drive
from meshslam.fleet.scheduling import Schedule
from meshslam.runs import Config, overlaid

from .machines import Machines
from .simulated_ray import DriverCosts
from .simulation import Day, simulate
from .tasks import Drives, Task

WORKERS = 2


def validated(cases: Sequence[Any], work: Path, figures: dict[str, Any], rounds: int) -> list[dict[str, Any]]:
    """Real and simulated makespan of each round and engine: by its own tasks' times, and by those of other rounds."""
    costs = {
        "local": DriverCosts(task_s=figures["local_driver_s"]),
        "ray": DriverCosts(submit_s=figures["ray_submit_s"], wait_s=figures["ray_wait_s"], get_s=figures["ray_get_s"]),
    }
    real = [(name, *run(name, cases, work)) for _ in range(rounds) for name in ("local", "ray")]
    rows = []
    for k, (name, makespan_s, results) in enumerate(real):
        others = [found for j, (other, _, found) in enumerate(real) if other == name and j != k]
        start_s = figures["worker_start_s"]
        own = simulate(_day([results], start_s, costs[name])).makespan_s
        row = {"engine": name, "real_s": makespan_s, "own_times_s": own}
        if others:
            row["other_rounds_times_s"] = simulate(_day(others, start_s, costs[name])).makespan_s
        rows.append(row)
        print(" ", row, flush=True)
    return rows


def run(engine: str, cases: Sequence[Any], work: Path) -> tuple[float, list[DriveResult]]:
    """Seconds of the real scheduler with a real engine, from its first look to its last task's end."""
    shutil.rmtree(work, ignore_errors=True)
    drives = tuple(
        Drive(case.name.replace(" ", "_").replace("/", "_"), case.given["sequence"], case.command, _settings(case))
        for case in cases
    )
    workers = engine_of(engine, None, WORKERS)
    schedule = Schedule(Fleet(Path("fleet.yaml"), drives), Folder(work), workers)
    try:
        began_s = time.perf_counter()
        schedule.run()
        took_s = time.perf_counter() - began_s
    finally:
        workers.close()
    results = schedule.results()
    failed = [f"{result.name}: {result.reason}" for result in results if result.how != "done"]
    if failed:
        raise SystemExit("\n".join(failed))
    return took_s, results


def _settings(case: Any) -> Config:  # cost_parts.cases.Case
    return overlaid(Config(), {"input": case.given}, case.name)


def _day(rounds: Sequence[Sequence[DriveResult]], start_s: float, costs: DriverCosts) -> Day:
    """The mean of some rounds' tasks, on one machine of as many CPUs as there were workers."""
    tasks = {results[0].name: dict(_means(results)) for results in zip(*rounds, strict=True)}
    return Day(Drives(tasks), Machines(1, float(WORKERS), start_s=start_s), costs)


def _means(results: Sequence[DriveResult]) -> Iterator[tuple[str, Task]]:
    for tasks in zip(*(result.tasks for result in results), strict=True):
        yield tasks[0].step, Task(sum(task.seconds for task in tasks) / len(tasks))
