"""The Ray engine: a job is a Ray task. Ray repeats nothing: what is lost is told, as by the local engine."""

from __future__ import annotations

import contextlib
import os
import secrets
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from meshslam.errors import ConfigError
from meshslam.fleet.board import Board
from meshslam.fleet.drives import Needs
from meshslam.fleet.jobs import Ended, Job, Outcome, Running
from meshslam.fleet.ray_losses import result_of
from meshslam.fleet.throttle import throttled
from meshslam.fleet.work import thread_settings, work

TOKEN, ADDRESS = "RAY_AUTH_TOKEN", "RAY_ADDRESS"
PATIENCE_S = 60.0  # with nodes that come later
_LOOK_S = 5.0  # between looks at the nodes
_GRACE_S = 5.0  # from Ctrl-C to the kill
_WORDS_PER_S = 400.0  # of all workers together, to the board: it takes five times as many
_MIB = 1024**2


@dataclass
class Cluster:
    """As many jobs at once as the cluster's CPUs hold, or as there are `workers`."""

    workers: int | None
    _ray: Any  # the module
    _board: Any
    _now_s: Callable[[], float] = time.monotonic
    _under_way: dict[Any, Job] = field(default_factory=dict)  # by reference
    _held: Counter[float] = field(default_factory=Counter)  # jobs under way by their CPUs
    _nodes: tuple[Mapping[str, float], ...] = ()
    _cpus: float = 0.0  # of all nodes
    _looked_s: float = float("-inf")
    _judged_s: float = float("-inf")
    _unfit_since_s: dict[Any, float] = field(default_factory=dict)

    @staticmethod
    def connect(address: str | None, workers: int | None) -> Cluster:
        """Join a cluster, or start Ray on this machine; ConfigError if that cannot be done."""
        ray = _ray()
        address = address or os.environ.get(ADDRESS)
        try:
            _init(ray, address, workers)
        except Exception as problem:  # Ray has several
            said = " ".join(str(problem).split())[:300]
            raise ConfigError(f"--address {address or 'local'}: Ray cannot be reached: {said}") from None
        here = ray.get_runtime_context().get_node_id()
        beside = ray.util.scheduling_strategies.NodeAffinitySchedulingStrategy(here, soft=True)
        board = ray.remote(Board).options(num_cpus=0, max_restarts=-1, scheduling_strategy=beside).remote()
        return Cluster(workers, ray, board)

    @cached_property
    def _task(self) -> Any:  # noqa: ANN401 # Ray's function
        """What a worker does with a job, sent to the cluster once."""
        return self._ray.remote(ray_work)

    def has_room(self, needs: Needs) -> bool:
        """Whether a job with these needs can begin now; one is always under way, as nodes may come for it."""
        if not self._under_way:
            return True
        if self.workers is not None and len(self._under_way) >= self.workers:
            return False
        held = sum(cpus * count for cpus, count in self._held.items())
        self._seen()
        return self.workers is not None or held + needs.cpus <= self._cpus

    def submit(self, job: Job) -> None:
        """Begin a job."""
        needs = job.needs
        options: dict[str, Any] = {
            "name": f"{job.drive.name}: {job.step}",
            "num_cpus": needs.cpus,
            "resources": dict(needs.others),
            "max_retries": 0,
            "runtime_env": {"env_vars": thread_settings(needs.threads)},
        }
        options |= {"num_gpus": needs.gpus} if needs.gpus else {}
        options |= {"memory": int(needs.memory_mb * _MIB)} if needs.memory_mb else {}
        every_s = max(1.0, len(self._under_way) / _WORDS_PER_S)
        self._under_way[self._task.options(**options).remote(job, self._board, every_s)] = job
        self._held[needs.cpus] += 1

    def ended(self, timeout_s: float) -> list[Ended]:
        """Jobs that have ended, as soon as there is one; none after the time is over."""
        references = list(self._under_way)
        ready, _ = self._ray.wait(references, num_returns=1, timeout=timeout_s)
        if not ready:
            return self._hopeless()
        ready, _ = self._ray.wait(references, num_returns=len(references), timeout=0.0)  # and all others that have
        return [Ended(self._gone(reference), result_of(self._ray, reference)) for reference in ready]

    def running(self) -> Sequence[Running]:
        """How far the jobs under way are; what is not known now is known later."""
        rows: Mapping[str, Running] = {}
        with contextlib.suppress(Exception):  # the board may be lost with its node: it comes again
            rows = self._ray.get(self._board.rows.remote(), timeout=1.0)
        jobs = self._under_way.values()
        told = [(job, rows.get(job.drive.name)) for job in jobs]
        return [
            row if row is not None and row.step == job.step else Running(job.drive.name, job.step) for job, row in told
        ]

    def close(self) -> None:
        """Cancel what is under way, so that it cleans up, kill what does not end, and leave the cluster."""
        ray, references = self._ray, list(self._under_way)
        for reference in references:
            ray.cancel(reference)
        left = ray.wait(references, num_returns=len(references), timeout=_GRACE_S)[1] if references else []
        for reference in left:
            ray.cancel(reference, force=True)
        self._under_way.clear()
        self._held.clear()
        with contextlib.suppress(Exception):
            ray.kill(self._board)
        ray.shutdown()

    def _seen(self) -> tuple[Mapping[str, float], ...]:
        """What each living node has in all, looked at now and then."""
        if self._now_s() - self._looked_s > _LOOK_S:
            self._nodes = tuple(node["Resources"] for node in self._ray.nodes() if node["Alive"])
            self._cpus = sum(node.get("CPU", 0.0) for node in self._nodes)
            self._looked_s = self._now_s()
        return self._nodes

    def _hopeless(self) -> list[Ended]:
        """Jobs that no node has been able to take for a while: Ray itself would wait for ever."""
        nodes, now_s = self._seen(), self._now_s()
        if now_s - self._judged_s < _LOOK_S:
            return []
        self._judged_s = now_s
        fits = {reference: any(_holds(node, job.needs) for node in nodes) for reference, job in self._under_way.items()}
        self._unfit_since_s = {r: self._unfit_since_s.get(r, now_s) for r, fit in fits.items() if not fit}
        late = [r for r, since_s in self._unfit_since_s.items() if now_s - since_s > PATIENCE_S]
        for reference in late:
            self._ray.cancel(reference, force=True)
        return [Ended(job, _no_node(job.needs)) for job in map(self._gone, late)]

    def _gone(self, reference: Any) -> Job:  # noqa: ANN401 # Ray's
        job = self._under_way.pop(reference)
        self._held[job.needs.cpus] -= 1
        return job


def ray_work(job: Job, board: Any, every_s: float) -> Outcome:  # noqa: ANN401 # an actor's handle
    """The job in a Ray worker, which tells the board how far it is."""

    def tell(doing: str, done: int, total: int) -> None:
        board.tell.remote(Running(job.drive.name, job.step, doing, done, total))

    found = work(job, throttled(tell, every_s))
    board.forget.remote(job.drive.name, job.step)
    return replace(found, node=f"{found.node}/{_ray().get_runtime_context().get_node_id()[:8]}")


def _init(ray: Any, address: str | None, workers: int | None) -> None:  # noqa: ANN401 # the module
    quiet = {"logging_level": "ERROR", "log_to_driver": False}
    if address is not None:
        ray.init(address=address, **quiet)
        return
    if not os.environ.get(TOKEN):  # of an instance of our own: Ray would leave one in the home folder for good
        os.environ[TOKEN] = secrets.token_hex(32)
    ray.init(address="local", num_cpus=workers, include_dashboard=False, **quiet)


def _holds(node: Mapping[str, float], needs: Needs) -> bool:
    """Whether a node that is idle can take a job."""
    wanted = {"CPU": needs.cpus, "GPU": needs.gpus, "memory": needs.memory_mb * _MIB, **needs.others}
    return all(node.get(name, 0.0) >= count for name, count in wanted.items())


def _no_node(needs: Needs) -> Outcome:
    return Outcome(reason=f"no node of the cluster has had what it needs for {PATIENCE_S:.0f} s: {needs}")


def _ray() -> Any:  # noqa: ANN401 # the module
    """Ray, which only this engine needs."""
    try:
        import ray
        import ray.util.scheduling_strategies
    except ImportError:
        raise ConfigError('--engine ray needs Ray: pip install "meshslam[ray]", or take --engine local') from None
    return ray
