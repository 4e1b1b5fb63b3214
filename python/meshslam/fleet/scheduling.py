"""Every drive through its steps, as many at a time as the engine has room for; a lost worker's step begins again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version

from meshslam.fleet.drives import Drive, Fleet
from meshslam.fleet.engine import Engine
from meshslam.fleet.jobs import Ended, Job, Loss, Outcome, Running
from meshslam.fleet.places import Place
from meshslam.fleet.results import DriveResult, Task
from meshslam.fleet.retrying import is_repeated, why_not
from meshslam.runs import DETECT

RETRIES = 2  # of a drive
_LOOK_S = 0.5


def _silent(_told: object) -> None:
    return


@dataclass(frozen=True)
class Watch:
    """Who is told how a fleet is doing: each drive that has ended, each loss, and now and then what is running."""

    ended: Callable[[DriveResult], None] = _silent
    lost: Callable[[str], None] = _silent
    running: Callable[[Sequence[Running]], None] = _silent


@dataclass
class DriveState:
    """A drive on its way."""

    drive: Drive
    number: int
    step: str = DETECT
    left: tuple[str, ...] = ()
    losses: list[Loss] = field(default_factory=list)
    tasks: list[Task] = field(default_factory=list)
    attempts: int = 1
    result: DriveResult | None = None

    @property
    def order(self) -> tuple[bool, int]:
        """Drives that have begun go first: what is under way stays little."""
        return (not self.tasks, self.number)


@dataclass
class Schedule:
    """What waits and what is under way."""

    fleet: Fleet
    place: Place
    engine: Engine
    retries: int = RETRIES
    overwrite: bool = False
    watch: Watch = field(default_factory=Watch)
    states: dict[str, DriveState] = field(default_factory=dict)
    waiting: list[DriveState] = field(default_factory=list)
    under_way: int = 0

    def __post_init__(self) -> None:
        self.waiting = [DriveState(drive, i) for i, drive in enumerate(self.fleet.drives)]
        self.states = {state.drive.name: state for state in self.waiting}

    def run(self) -> None:
        """Until every drive has ended."""
        while self.waiting or self.under_way:
            self._begin()
            for ended in self.engine.ended(_LOOK_S):
                self._take(ended)
            self.watch.running(self.engine.running())

    def results(self) -> list[DriveResult]:
        """Of every drive, those that have not ended, too."""
        return [state.result or DriveResult.of(state.drive, "not run", state.tasks) for state in self.states.values()]

    def _begin(self) -> None:
        """Submit what there is room for."""
        for state in sorted(self.waiting, key=lambda state: state.order):
            needs = self.fleet.needs_of(state.step)
            if self.engine.has_room(needs):
                self.waiting.remove(state)
                self.under_way += 1
                self.engine.submit(self._job(state))

    def _job(self, state: DriveState) -> Job:
        name, needs = state.drive.name, self.fleet.needs_of(state.step)
        if self.place.is_shared:
            where: dict[str, object] = {"out": self.place.run(name)}
        else:
            where = {"files": self.place.read(name)}
        return Job(state.drive, state.step, needs, version("meshslam"), overwrite=self.overwrite, **where)  # type: ignore[arg-type]

    def _take(self, ended: Ended) -> None:
        """Go on with the next step, or end, or begin the step again."""
        self.under_way -= 1
        state, result = self.states[ended.job.drive.name], ended.result
        state.tasks.append(Task.of(ended))
        if isinstance(result, Loss):
            self._lost(state, result)
        elif result.reason:
            self._end(state, "failed", result)
        else:
            self._went_well(state, result)

    def _went_well(self, state: DriveState, outcome: Outcome) -> None:
        if outcome.changes:
            self.place.write(state.drive.name, outcome.changes)
        if outcome.left:
            state.step, *left = outcome.left
            state.left = tuple(left)
            self.waiting.append(state)
        else:
            self._end(state, "unchanged" if outcome.was_there else "done", outcome)

    def _lost(self, state: DriveState, loss: Loss) -> None:
        repeated = is_repeated(loss, state.losses, self.retries)
        state.losses.append(loss)
        if repeated:
            state.attempts += 1
            self.waiting.append(state)
            self.watch.lost(f"{state.drive.name}: {state.step}: {loss.text}: again")
        else:
            self._end(state, "failed", Outcome(reason=f"{state.step}: {loss.text}: {why_not(state.losses)}"))

    def _end(self, state: DriveState, how: str, outcome: Outcome) -> None:
        state.result = DriveResult.of(state.drive, how, state.tasks, outcome, state.attempts, self.place)
        self.watch.ended(state.result)
