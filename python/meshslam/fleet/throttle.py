"""Progress that is told now and then."""

from __future__ import annotations

import time
from collections.abc import Callable

Progress = Callable[[str, int, int], None]


def throttled(tell: Progress, every_s: float, now_s: Callable[[], float] = time.monotonic) -> Progress:
    """The same, but no more often than that; another name is told at once."""
    last: tuple[str, float] = ("", float("-inf"))

    def told(doing: str, done: int, total: int) -> None:
        nonlocal last
        if doing != last[0] or now_s() - last[1] >= every_s:
            last = (doing, now_s())
            tell(doing, done, total)

    return told
