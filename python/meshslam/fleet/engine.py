"""What runs a fleet's jobs: processes of this machine, or Ray."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from meshslam.fleet.drives import Needs
from meshslam.fleet.jobs import Ended, Job, Running


class Engine(Protocol):
    """Takes jobs while it has room and tells how each ended; a lost worker is told, and its job is not repeated."""

    def has_room(self, needs: Needs) -> bool:
        """Whether a job with these needs can begin now."""
        ...

    def submit(self, job: Job) -> None:
        """Begin a job."""
        ...

    def ended(self, timeout_s: float) -> list[Ended]:
        """Jobs that have ended, as soon as there is one; none after the time is over."""
        ...

    def running(self) -> Sequence[Running]:
        """How far the jobs under way are."""
        ...

    def close(self) -> None:
        """End all that is under way and every process of this engine."""
        ...
