"""Drives of a fleet, each with its command and settings, and what their steps need."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from meshslam.runs import Config


@dataclass(frozen=True)
class Needs:
    """What a step holds while it runs: an engine starts no more than there is room for."""

    cpus: float = 1.0
    gpus: float = 0.0
    memory_mb: float = 0.0
    others: Mapping[str, float] = field(default_factory=dict)  # Ray's custom resources by name

    @property
    def threads(self) -> int:
        """Threads that the step computes with."""
        return max(1, int(self.cpus))

    def __str__(self) -> str:
        known = {"CPU": self.cpus, "GPU": self.gpus, "MB of memory": self.memory_mb}
        return ", ".join(f"{name} {count:g}" for name, count in {**known, **self.others}.items() if count)


@dataclass(frozen=True)
class Drive:
    """A recording, and what is to be done with it; `name` is its folder's in the fleet."""

    name: str
    recording: str  # a path, or a URL that fsspec reads
    command: str  # map, localize or slam
    settings: Config


@dataclass(frozen=True)
class Fleet:
    """What a fleet file says."""

    source: Path
    drives: tuple[Drive, ...]
    needs: Mapping[str, Needs] = field(default_factory=dict)  # by step; those that are not named take one CPU

    def needs_of(self, step: str) -> Needs:
        """What a step needs."""
        return self.needs.get(step, Needs())
