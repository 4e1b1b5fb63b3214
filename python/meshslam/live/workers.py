"""Threads that take one thing after the other."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

_T = TypeVar("_T")


class Newest(Generic[_T]):
    """A place for one thing: a newer one takes it from an older one that nobody has fetched."""

    def __init__(self) -> None:
        self._held: list[_T] = []
        self._closed = False
        self._news = threading.Condition()

    def put(self, thing: _T) -> None:
        """Never waits."""
        with self._news:
            self._held = [thing]
            self._news.notify()

    def close(self) -> None:
        """What is held can still be fetched; after it comes None."""
        with self._news:
            self._closed = True
            self._news.notify_all()

    def get(self) -> _T | None:
        """Wait for the next thing; None after the last."""
        with self._news:
            self._news.wait_for(lambda: self._held or self._closed)
            return self._held.pop() if self._held else None


class InOrder(Generic[_T]):
    """A queue that can be closed; who fills it keeps it short."""

    def __init__(self) -> None:
        self._queue: queue.SimpleQueue[_T | None] = queue.SimpleQueue()

    def put(self, thing: _T) -> None:
        """Never waits."""
        self._queue.put(thing)

    def close(self) -> None:
        """After what is in the queue comes None."""
        self._queue.put(None)

    def get(self) -> _T | None:
        """Wait for the next thing; None after the last."""
        return self._queue.get()

    def __len__(self) -> int:
        return self._queue.qsize()


class Worker(Generic[_T]):
    """A thread that does one thing after the other, until its source is closed or something is raised."""

    def __init__(
        self,
        name: str,
        source: Newest[_T] | InOrder[_T],
        work: Callable[[_T], None],
        on_error: Callable[[BaseException], None],
    ) -> None:
        self._source, self._work, self._on_error = source, work, on_error
        self._thread = threading.Thread(target=self._run, name=f"meshslam-{name}", daemon=True)
        self._thread.start()

    def finish(self) -> None:
        """Close the source, and wait until all of it is done."""
        self._source.close()
        self._thread.join()

    def _run(self) -> None:
        try:
            while (thing := self._source.get()) is not None:
                self._work(thing)
        except BaseException as error:  # is raised where the user of the pipeline calls next
            self._on_error(error)
