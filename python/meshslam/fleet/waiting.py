"""Drives on their way, and those of them that wait for room, in the order that they go."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from heapq import heappop, heappush

from meshslam.fleet.drives import Drive
from meshslam.fleet.jobs import Loss
from meshslam.fleet.results import DriveResult, Task
from meshslam.runs import DETECT

Order = tuple[bool, int]


@dataclass(eq=False)
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
    def order(self) -> Order:
        """Drives that have begun go first: what is under way stays little."""
        return (not self.tasks, self.number)


class Waiting:
    """Drives by the step that they wait for. Taking one does not look at the others: there may be 100,000."""

    def __init__(self) -> None:
        self._by_step: dict[str, list[tuple[Order, DriveState]]] = {}

    def __len__(self) -> int:
        return sum(map(len, self._by_step.values()))

    def add(self, state: DriveState) -> None:
        """Let a drive wait."""
        heappush(self._by_step.setdefault(state.step, []), (state.order, state))

    def take(self, has_room: Callable[[str], bool]) -> DriveState | None:
        """The first drive whose step there is room for; None if there is none."""
        for _, step in sorted((heap[0][0], step) for step, heap in self._by_step.items() if heap):
            if has_room(step):
                return heappop(self._by_step[step])[1]
        return None
