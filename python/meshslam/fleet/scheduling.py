"""Every drive through its steps, as many at a time as the engine has room for; a lost worker's step begins again."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version

from meshslam.fleet.drives import Fleet
from meshslam.fleet.engine import Engine
from meshslam.fleet.jobs import Ended, Job, Loss, Outcome, Running
from meshslam.fleet.places import Place
from meshslam.fleet.results import DriveResult, Task
from meshslam.fleet.retrying import is_repeated, why_not
from meshslam.fleet.waiting import DriveState, Waiting

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
class Schedule:
    """What waits and what is under way."""

    fleet: Fleet
    place: Place
    engine: Engine
    retries: int = RETRIES
    overwrite: bool = False
    watch: Watch = field(default_factory=Watch)
    now_s: Callable[[], float] = time.monotonic
    states: dict[str, DriveState] = field(default_factory=dict)
    waiting: Waiting = field(default_factory=Waiting)
    under_way: int = 0
    _version: str = field(default_factory=lambda: version("meshslam"))
    _looked_s: float = float("-inf")

    def __post_init__(self) -> None:
        for number, drive in enumerate(self.fleet.drives):
            self.states[drive.name] = DriveState(drive, number)
            self.waiting.add(self.states[drive.name])

    def run(self) -> None:
        """Until every drive has ended."""
        while self.waiting or self.under_way:
            self._begin()
            for ended in self.engine.ended(_LOOK_S):
                self._take(ended)
            self._look()

    def results(self) -> list[DriveResult]:
        """Of every drive, those that have not ended, too."""
        return [state.result or DriveResult.of(state.drive, "not run", state.tasks) for state in self.states.values()]

    def _begin(self) -> None:
        """Submit what there is room for."""
        while (state := self.waiting.take(self._has_room)) is not None:
            self.under_way += 1
            self.engine.submit(self._job(state))

    def _has_room(self, step: str) -> bool:
        return self.engine.has_room(self.fleet.needs_of(step))

    def _look(self) -> None:
        """Tell what is running, now and then: workers are asked for it."""
        if self.now_s() - self._looked_s >= _LOOK_S:
            self._looked_s = self.now_s()
            self.watch.running(self.engine.running())

    def _job(self, state: DriveState) -> Job:
        name, needs = state.drive.name, self.fleet.needs_of(state.step)
        if self.place.is_shared:
            where: dict[str, object] = {"out": self.place.run(name)}
        else:
            where = {"files": self.place.read(name)}
        return Job(state.drive, state.step, needs, self._version, overwrite=self.overwrite, **where)  # type: ignore[arg-type]

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
            self.waiting.add(state)
        else:
            self._end(state, "unchanged" if outcome.was_there else "done", outcome)

    def _lost(self, state: DriveState, loss: Loss) -> None:
        repeated = is_repeated(loss, state.losses, self.retries)
        state.losses.append(loss)
        if repeated:
            state.attempts += 1
            self.waiting.add(state)
            self.watch.lost(f"{state.drive.name}: {state.step}: {loss.text}: again")
        else:
            self._end(state, "failed", Outcome(reason=f"{state.step}: {loss.text}: {why_not(state.losses)}"))

    def _end(self, state: DriveState, how: str, outcome: Outcome) -> None:
        state.result = DriveResult.of(state.drive, how, state.tasks, outcome, state.attempts, self.place)
        self.watch.ended(state.result)
