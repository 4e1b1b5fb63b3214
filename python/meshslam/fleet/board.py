"""Where Ray's workers tell how far they are, and the driver looks."""

from __future__ import annotations

from meshslam.fleet.jobs import Running


class Board:
    """The last word of each drive that is at work."""

    def __init__(self) -> None:
        self._rows: dict[str, Running] = {}

    def tell(self, row: Running) -> None:
        """Take a drive's word."""
        self._rows[row.drive] = row

    def forget(self, drive: str, step: str) -> None:
        """A drive's step has ended."""
        if drive in self._rows and self._rows[drive].step == step:
            del self._rows[drive]

    def rows(self) -> dict[str, Running]:
        """By drive."""
        return self._rows
