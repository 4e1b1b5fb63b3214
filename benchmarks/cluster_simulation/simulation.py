"""A day's drives through the fleet's scheduler and its Ray engine, on simulated nodes."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from meshslam.fleet import DriveResult, Fleet, Folder, Watch
from meshslam.fleet.cluster import Cluster
from meshslam.fleet.drives import Drive, Needs
from meshslam.fleet.scheduling import RETRIES, Schedule
from meshslam.runs import Config

from .machines import Machines
from .simulated_ray import DriverCosts, SimulatedRay
from .tasks import Drives


@dataclass(frozen=True)
class Day:
    """What is to be done, on what."""

    drives: Drives
    machines: Machines
    costs: DriverCosts = field(default_factory=DriverCosts)
    needs: dict[str, Needs] = field(default_factory=dict)  # by step
    workers: int | None = None
    retries: int = RETRIES


@dataclass(frozen=True)
class Report:
    """What came of it."""

    makespan_s: float
    most_done_s: float  # when 99% of the drives had ended
    utilization: float  # useful seconds of CPUs over all that the nodes had until the end
    wasted: float  # seconds of CPUs that were lost, over all that were spent
    losses: int  # tasks
    driver_busy: float  # share of the makespan
    drive_p50_s: float  # from the first task's submission to the end
    drive_p99_s: float
    failed: int  # drives that lost too many workers
    results: tuple[DriveResult, ...]
    ended: dict[tuple[str, str], int]  # how often each step ended well
    at_work: tuple[tuple[float, int], ...]  # how many tasks were, from a time on

    def mean_at_work(self, parts: int) -> list[float]:
        """Tasks at work, in equal parts of the makespan."""
        times, counts = np.array([(0.0, 0), *self.at_work, (self.makespan_s, 0)]).T
        spent = np.concatenate([[0.0], np.cumsum(counts[:-1] * np.diff(times))])
        edges = np.linspace(0.0, self.makespan_s, parts + 1)
        return (np.diff(np.interp(edges, times, spent)) / np.diff(edges)).tolist()


def simulate(day: Day) -> Report:
    """Let the fleet's scheduler and its engine for Ray run until every drive has ended."""
    ray = SimulatedRay(day.machines, day.drives, day.costs)
    settings, began_s, ended_s = Config(), dict[str, float](), dict[str, float]()
    fleet = Fleet(Path("day.yaml"), tuple(Drive(name, name, "map", settings) for name in day.drives.tasks), day.needs)
    engine = _Timed(day.workers, ray, ray.board(), lambda: ray.now_s, began_s=began_s)
    watch = Watch(ended=lambda result: ended_s.setdefault(result.name, ray.now_s))
    schedule = Schedule(fleet, Folder(Path("day")), engine, day.retries, watch=watch, now_s=lambda: ray.now_s)
    schedule.run()
    results, account = tuple(schedule.results()), ray.account
    took_s = [ended_s[name] - began_s[name] for name in ended_s]
    spent_s, had_s = account.useful_s + account.lost_s, day.machines.nodes * day.machines.cpus * ray.now_s
    return Report(
        ray.now_s,
        float(np.percentile(list(ended_s.values()), 99)),
        account.useful_s / had_s if had_s else 1.0,
        account.lost_s / spent_s if spent_s else 0.0,
        account.losses,
        account.driver_s / ray.now_s if ray.now_s else 0.0,
        float(np.percentile(took_s, 50)),
        float(np.percentile(took_s, 99)),
        sum(result.how == "failed" for result in results),
        results,
        account.ended,
        tuple(account.at_work),
    )


@dataclass
class _Timed(Cluster):
    """The engine for Ray, with the time when each drive began. It asks how far tasks are, and drops the answer."""

    began_s: dict[str, float] = field(default_factory=dict)

    def submit(self, job):
        """Begin a job."""
        self.began_s.setdefault(job.drive.name, self._now_s())
        super().submit(job)

    def running(self):
        """Nothing, after the time that an answer takes."""
        self._ray.get(self._board.rows.remote())
        return []
