"""The local engine: worker processes of this machine. A worker that is lost takes no other with it."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, Pipe, wait
from typing import IO

from meshslam.fleet.drives import Needs
from meshslam.fleet.jobs import Ended, Job, Loss, Outcome, Running
from meshslam.fleet.work import thread_settings

_GRACE_S = 5.0  # from Ctrl-C to the kill


@dataclass
class Worker:
    """A process, the connection to it, and the job that it has."""

    process: subprocess.Popen[bytes]
    connection: Connection
    errors: IO[bytes]
    threads: int
    job: Job | None = None
    running: Running | None = None

    @staticmethod
    def start(threads: int) -> Worker:
        """A process of its own group: the terminal's Ctrl-C is for the driver, which tells its workers."""
        ours, theirs = Pipe()
        errors = tempfile.TemporaryFile()  # noqa: SIM115 # it lives as long as the worker
        with theirs:
            process = subprocess.Popen(
                [sys.executable, "-m", "meshslam.fleet.worker", str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                env={**os.environ, **thread_settings(threads)},
                stdin=subprocess.DEVNULL,
                stdout=errors,
                stderr=errors,
                process_group=0,
            )
        return Worker(process, ours, errors, threads)

    def give(self, job: Job) -> None:
        """Let it do a job."""
        self.job, self.running = job, Running(job.drive.name, job.step)
        with contextlib.suppress(OSError):  # it has died: that is told when it is waited for
            self.connection.send(job)

    def loss(self) -> Loss:
        """Why it was lost."""
        code = self.process.wait()
        self.errors.seek(0)
        last = self.errors.read().decode(errors="replace").strip().splitlines()[-1:]
        ended = f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with code {code}"
        hint = " (out of memory, if nobody killed it: give fewer --workers)" if -code == signal.SIGKILL else ""
        return Loss("worker", f"worker process {self.process.pid} {ended}{hint}{''.join(f': {line}' for line in last)}")

    def end(self, grace_s: float = 0.0) -> None:
        """Kill it, if it has not ended by then."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(grace_s)
        self.process.kill()
        self.process.wait()
        self.connection.close()
        self.errors.close()


@dataclass
class Processes:
    """As many jobs at once as the machine's CPUs hold, or as there are `workers`."""

    workers: int | None = None
    cpus: float = field(default_factory=lambda: float(usual_cpus()))
    _all: list[Worker] = field(default_factory=list)

    def has_room(self, needs: Needs) -> bool:
        """Whether a job with these needs can begin now; resources beside CPUs are Ray's."""
        held = [worker.job.needs.cpus for worker in self._all if worker.job is not None]
        if self.workers is not None:
            return len(held) < self.workers
        return not held or sum(held) + needs.cpus <= self.cpus

    def submit(self, job: Job) -> None:
        """Give a job to a worker with its number of threads."""
        idle = [worker for worker in self._all if worker.job is None]
        fitting = next((worker for worker in idle if worker.threads == job.needs.threads), None)
        if fitting is None:
            if idle:
                self._drop(idle[0])
            fitting = Worker.start(job.needs.threads)
            self._all.append(fitting)
        fitting.give(job)

    def ended(self, timeout_s: float) -> list[Ended]:
        """Jobs that have ended, as soon as there is one; none after the time is over."""
        by_connection = {worker.connection: worker for worker in self._all}
        ready = [by_connection[c] for c in wait(list(by_connection), timeout_s) if isinstance(c, Connection)]
        return [ended for worker in ready for ended in self._heard(worker)]

    def running(self) -> Sequence[Running]:
        """How far the jobs under way are."""
        return [worker.running for worker in self._busy() if worker.running is not None]

    def close(self) -> None:
        """Interrupt what is under way, so that it cleans up, and end all workers."""
        busy = self._busy()
        for worker in busy:
            with contextlib.suppress(ProcessLookupError):
                worker.process.send_signal(signal.SIGINT)
        for worker in self._all:
            worker.end(_GRACE_S if worker in busy else 0.0)
        self._all.clear()

    def _busy(self) -> list[Worker]:
        return [worker for worker in self._all if worker.job is not None]

    def _heard(self, worker: Worker) -> list[Ended]:
        """What a worker has said, or that it is lost."""
        job = worker.job
        try:
            message = worker.connection.recv()
        except (EOFError, OSError):
            loss = worker.loss()
            self._drop(worker)
            return [] if job is None else [Ended(job, loss)]
        if isinstance(message, Running):
            worker.running = message
        if not isinstance(message, Outcome) or job is None:
            return []
        worker.job = worker.running = None
        return [Ended(job, message)]

    def _drop(self, worker: Worker) -> None:
        self._all.remove(worker)
        worker.end()


def usual_cpus() -> int:
    """As many as there are CPUs for this process."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
