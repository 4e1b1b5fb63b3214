"""What a run takes: seconds and memory."""

from __future__ import annotations

import os
import resource
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

REPORT = "report"  # drawn once the result is there


@dataclass
class Clock:
    """Seconds spent in each stage, and since the user began to wait; both by `time.perf_counter`."""

    began_s: float = field(default_factory=time.perf_counter)
    imports_s: float | None = None  # of a process that only does this run: until the run itself began
    seconds: dict[str, float] = field(default_factory=dict)

    @staticmethod
    def of_process() -> Clock:
        """A clock that has run since the process began: the interpreter's start and all imports are in it."""
        age_s = process_age_s()
        return Clock(time.perf_counter() - age_s, age_s)

    @contextmanager
    def timing(self, stage: str) -> Iterator[None]:
        """Add the block's time to a stage."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - start

    def move(self, from_stage: str, to_stage: str, seconds: float) -> None:
        """Count a part of one stage's time as another's."""
        self.seconds[from_stage] = self.seconds.get(from_stage, 0.0) - seconds
        self.seconds[to_stage] = self.seconds.get(to_stage, 0.0) + seconds

    def figures(self, frames: int) -> dict[str, float]:
        """Times and memory up to now, as docs/formats.md names them."""
        stages = sum(seconds for stage, seconds in self.seconds.items() if stage != REPORT)
        found = {"seconds_total": time.perf_counter() - self.began_s}
        if self.imports_s is not None:
            found["seconds_imports"] = self.imports_s
        found |= {f"seconds_{stage}": seconds for stage, seconds in self.seconds.items()}
        found |= {"milliseconds_per_frame": 1e3 * stages / max(1, frames), "peak_memory_mb": peak_memory_mb()}
        return {key: round(value, 6) for key, value in found.items()}


def peak_memory_mb() -> float:
    """The most memory that this process has held so far, MiB."""
    held = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return held / (1024**2 if sys.platform == "darwin" else 1024)  # bytes there, KiB elsewhere


def process_age_s() -> float:
    """Seconds since this process began; where the system does not tell (it is Linux that does), its CPU time."""
    with suppress(OSError, ValueError, IndexError):
        after_name = Path("/proc/self/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
        began_s = int(after_name[19]) / os.sysconf("SC_CLK_TCK")  # field 22 of proc(5), since boot
        return max(0.0, time.clock_gettime(time.CLOCK_BOOTTIME) - began_s)
    return time.process_time()
