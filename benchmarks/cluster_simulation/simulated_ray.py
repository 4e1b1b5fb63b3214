"""What the fleet's driver calls of Ray, with simulated nodes, a simulated clock, and the driver's own time charged."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from types import SimpleNamespace

from meshslam.fleet.jobs import Job, Outcome

from .machines import INFINITE, Machines
from .tasks import Drives


@dataclass(frozen=True)
class DriverCosts:
    """Seconds that the driver's thread is busy: measured with the real Ray, see benchmarks/costs.py."""

    task_s: float = 0.0  # the scheduler's own code, for each task
    submit_s: float = 0.0
    wait_s: float = 0.0
    wait_reference_s: float = 0.0  # for each task under way
    get_s: float = 0.0
    board_s: float = 0.0
    board_row_s: float = 0.0


class NodeDiedError(Exception):
    """The node of a task was lost."""


class _Never(Exception):  # noqa: N818 # never raised
    """Errors of Ray that are not simulated."""


@dataclass(eq=False)
class Node:
    """A machine."""

    number: int
    cpus: float
    slowness: float
    losses_s: Iterator[float]
    cold_cpus: float
    lost_s: float = 0.0
    free: float = 0.0
    is_alive: bool = True
    tasks: dict[int, Attempt] = field(default_factory=dict)


@dataclass(eq=False)
class Attempt:
    """A task that was submitted: the job, where it runs, and what came of it."""

    reference: int
    job: Job
    number: int = 1  # of the attempts at this step
    node: Node | None = None
    began_s: float = 0.0
    takes_s: float = 0.0
    result: Outcome | NodeDiedError | None = None


@dataclass
class Account:
    """Where time went, in seconds of CPUs, and of the driver."""

    useful_s: float = 0.0
    lost_s: float = 0.0  # of attempts whose work is done again
    losses: int = 0
    driver_s: float = 0.0
    ended: dict[tuple[str, str], int] = field(default_factory=dict)  # how often each step ended well
    at_work: list[tuple[float, int]] = field(default_factory=list)  # tasks, from a time on


class SimulatedRay:
    """As the module `ray`, for one driver. Time passes as the driver's calls take it, or as it waits."""

    exceptions = SimpleNamespace(
        NodeDiedError=NodeDiedError,
        OutOfMemoryError=_Never,
        RayTaskError=_Never,
        RuntimeEnvSetupError=_Never,
        ObjectLostError=_Never,
        RayError=_Never,
    )

    def __init__(self, machines: Machines, drives: Drives, costs: DriverCosts | None = None) -> None:
        self.machines, self.drives, self.costs = machines, drives, costs or DriverCosts()
        self.now_s, self.account = 0.0, Account()
        self._events: list[tuple[float, int, Callable[[float], None]]] = []
        self._count = 0
        self._attempts: dict[int, Attempt] = {}
        self._ready: dict[int, Attempt] = {}
        self._queue: deque[Attempt] = deque()
        self._tries: dict[tuple[str, str], int] = {}
        self._done_share: dict[tuple[str, str], float] = {}
        self._at_work = 0
        self._nodes = [self._node(k) for k in range(machines.nodes)]
        self._free = dict.fromkeys(self._nodes)

    # What the driver calls

    def remote(self, _function: object) -> SimpleNamespace:
        """A function that is run by the cluster."""
        return SimpleNamespace(options=lambda **_options: SimpleNamespace(remote=self._submit))

    def board(self) -> SimpleNamespace:
        """The actor that workers tell how far they are."""
        return SimpleNamespace(rows=SimpleNamespace(remote=lambda: None))

    def nodes(self) -> list[dict[str, object]]:
        """Every node with its resources."""
        return [{"Alive": node.is_alive, "Resources": {"CPU": node.cpus}} for node in self._nodes]

    def wait(self, references: list[int], num_returns: int, timeout: float) -> tuple[list[int], list[int]]:
        """Tasks that have ended; time passes until there is one."""
        self._charge(self.costs.wait_s + self.costs.wait_reference_s * len(references))
        end_s = self.now_s + timeout
        while not self._ready and self._events and self._events[0][0] <= end_s:
            self._happen()
        if not self._ready:
            self.now_s = max(self.now_s, end_s)
        return list(self._ready)[:num_returns], []

    def get(self, reference: int | None, timeout: float | None = None) -> object:
        """A task's outcome; NodeDiedError if its node was lost. Of the board, its rows."""
        if reference is None:
            self._charge(self.costs.board_s + self.costs.board_row_s * self._at_work)
            return {}
        self._charge(self.costs.get_s)
        result = self._ready.pop(reference).result
        del self._attempts[reference]
        if isinstance(result, NodeDiedError):
            raise result
        return result

    def cancel(self, reference: int, force: bool) -> None:
        """A task that waits for a node is not run."""
        attempt = self._attempts.pop(reference)
        self._queue.remove(attempt)

    # What happens in the cluster

    def _submit(self, job: Job, _board: object, _every_s: float) -> int:
        self._charge(self.costs.task_s + self.costs.submit_s)
        key = (job.drive.name, job.step)
        self._tries[key] = self._tries.get(key, 0) + 1
        self._count += 1
        attempt = Attempt(self._count, job, self._tries[key])
        self._attempts[attempt.reference] = attempt
        self._queue.append(attempt)
        self._place()
        return attempt.reference

    def _charge(self, seconds: float) -> None:
        """The driver's thread is busy; the cluster goes on."""
        self.account.driver_s += seconds
        until_s = self.now_s + seconds
        while self._events and self._events[0][0] <= until_s:
            self._happen()
        self.now_s = until_s

    def _at(self, time_s: float, what: Callable[[float], None]) -> None:
        if time_s < INFINITE:
            self._count += 1
            heapq.heappush(self._events, (time_s, self._count, what))

    def _happen(self) -> None:
        time_s, _, what = heapq.heappop(self._events)
        self.now_s = max(self.now_s, time_s)
        what(time_s)

    def _node(self, number: int) -> Node:
        of = self.machines
        node = Node(number, of.cpus, of.slowness(number), of.losses_s(number), of.cpus, free=of.cpus)
        self._await_loss(node, 0.0)
        return node

    def _await_loss(self, node: Node, now_s: float) -> None:
        node.lost_s = next(at_s for at_s in node.losses_s if at_s >= now_s)
        self._at(node.lost_s, lambda at_s: self._lose(node, at_s))

    def _place(self) -> None:
        """Let waiting tasks begin where there is room, the first first."""
        while self._queue:
            cpus = self._queue[0].job.needs.cpus
            node = next((node for node in self._free if node.free >= cpus), None)
            if node is None:
                return
            self._begin(self._queue.popleft(), node)

    def _begin(self, attempt: Attempt, node: Node) -> None:
        job, key = attempt.job, (attempt.job.drive.name, attempt.job.step)
        self._count_work(1)
        node.free -= job.needs.cpus
        if node.free <= 0:
            del self._free[node]
        task = self.drives.tasks[key[0]][key[1]]
        left = 1.0 - self._done_share.get(key, 0.0)
        compute_s = left * task.compute_s * node.slowness * self.drives.factor(*key, attempt.number)
        seconds = self.machines.storage.seconds(compute_s, left * task.read_bytes, self._at_work)
        cold = min(node.cold_cpus, job.needs.cpus)
        node.cold_cpus -= cold
        attempt.node, attempt.began_s = node, self.now_s
        attempt.takes_s = seconds + (self.machines.start_s if cold else 0.0)
        node.tasks[attempt.reference] = attempt
        self._at(self.now_s + attempt.takes_s, lambda _: self._end(attempt, node))

    def _end(self, attempt: Attempt, node: Node) -> None:
        if node.tasks.pop(attempt.reference, None) is None:
            return  # its node was lost before
        drive, step = attempt.job.drive.name, attempt.job.step
        self._leave(attempt, node)
        self.account.useful_s += attempt.takes_s * attempt.job.needs.cpus
        self.account.ended[drive, step] = self.account.ended.get((drive, step), 0) + 1
        attempt.result = Outcome(
            left=self.drives.after(drive, step),
            figures={"objects_mapped": 1.0},
            seconds=attempt.takes_s,
            node=str(node.number),
        )
        self._ready[attempt.reference] = attempt
        self._place()

    def _leave(self, attempt: Attempt, node: Node) -> None:
        self._count_work(-1)
        node.free += attempt.job.needs.cpus
        if node.is_alive:
            self._free[node] = None

    def _count_work(self, change: int) -> None:
        self._at_work += change
        self.account.at_work.append((self.now_s, self._at_work))

    def _lose(self, node: Node, at_s: float) -> None:
        """The node is gone with all that it does; the driver hears of it later, and another takes its place."""
        node.is_alive = False
        self._free.pop(node, None)
        lost, node.tasks = node.tasks, {}
        for attempt in lost.values():
            self._leave(attempt, node)
            self._give_up(attempt, at_s)
            self._at(at_s + self.machines.noticed_after_s, lambda _, attempt=attempt: self._tell_loss(attempt))
        self._at(at_s + self.machines.replaced_after_s, lambda back_s: self._replace(node, back_s))

    def _give_up(self, attempt: Attempt, at_s: float) -> None:
        key = (attempt.job.drive.name, attempt.job.step)
        spent_s = at_s - attempt.began_s
        self.account.losses += 1
        if self.drives.tasks[key[0]][key[1]].resumes and attempt.takes_s > 0:
            done = self._done_share.get(key, 0.0)
            self._done_share[key] = done + (1.0 - done) * spent_s / attempt.takes_s
            self.account.useful_s += spent_s * attempt.job.needs.cpus
        else:
            self.account.lost_s += spent_s * attempt.job.needs.cpus

    def _tell_loss(self, attempt: Attempt) -> None:
        attempt.result = NodeDiedError("The node is dead")
        self._ready[attempt.reference] = attempt

    def _replace(self, node: Node, at_s: float) -> None:
        node.is_alive, node.free, node.cold_cpus = True, node.cpus, node.cpus
        self._free[node] = None
        self._await_loss(node, at_s)
        self._place()
