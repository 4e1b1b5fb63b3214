"""A worker process of the local engine: it takes jobs from a connection and ends when that does."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from queue import SimpleQueue

from meshslam.fleet.jobs import Job, Outcome, Running
from meshslam.fleet.throttle import throttled
from meshslam.fleet.work import work


def serve(connection: Connection) -> None:
    """Do jobs one after the other; between them, messages say how far each is."""
    jobs: SimpleQueue[Job] = SimpleQueue()
    threading.Thread(target=_take, args=(connection, jobs), daemon=True).start()
    while True:
        job = jobs.get()
        connection.send(work(job, throttled(_teller(connection, job), every_s=0.2)))


def _take(connection: Connection, jobs: SimpleQueue[Job]) -> None:
    """Put jobs into the queue; without the one that sends them, the process has nothing to live for."""
    try:
        while True:
            jobs.put(connection.recv())
    except (EOFError, OSError):
        os._exit(1)


def _teller(connection: Connection, job: Job) -> Callable[[str, int, int], None]:
    def tell(doing: str, done: int, total: int) -> None:
        message: Outcome | Running = Running(job.drive.name, job.step, doing, done, total)
        connection.send(message)

    return tell


if __name__ == "__main__":
    serve(Connection(int(sys.argv[1])))
