"""Flags that show a run while it computes, or keep what it told."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from meshslam.cli.options import with_flags
from meshslam.errors import ConfigError

if TYPE_CHECKING:
    from meshslam.viewing import OpenedLog

VIEWERS: dict[str, Any] = {
    "view": Annotated[bool | None, typer.Option("--view", help="Show the run in the Rerun viewer while it computes.")],
    "serve": Annotated[
        bool | None,
        typer.Option("--serve", help="Serve the Rerun viewer as a page of this machine, until Ctrl-C."),
    ],
    "rrd": Annotated[Path | None, typer.Option(help="Keep what is shown as a recording for the Rerun viewer (.rrd).")],
    "mcap": Annotated[Path | None, typer.Option(help="Keep what is shown with Foxglove's schemas (.mcap).")],
    "colour": Annotated[
        Literal["id", "sigma"] | None,
        typer.Option(help="Colours of meshes in these: by id (default), or by the sigma of their vertices."),
    ],
}


@dataclass(frozen=True)
class Viewers:
    """The viewers and files that the flags ask for."""

    view: bool
    serve: bool
    rrd: Path | None
    mcap: Path | None
    colour: Literal["id", "sigma"] | None

    @staticmethod
    def of_flags(given: dict[str, Any]) -> Viewers:
        """What `VIEWERS` gives."""
        return Viewers(bool(given["view"]), bool(given["serve"]), given["rrd"], given["mcap"], given["colour"])

    @contextmanager
    def opened(self, out: Path, *, overwrite: bool) -> Iterator[OpenedLog | None]:
        """The log of a run while the block runs, None without flags; ConfigError before it if one cannot be opened.

        What was told is whole afterwards, whatever ended the block. A page is served until Ctrl-C.
        """
        log = self._open(out, overwrite=overwrite)
        try:
            yield log
            if log is not None and log.web_address is not None:
                _serve_on(log)
        finally:
            if log is not None:
                log.close()

    def _open(self, out: Path, *, overwrite: bool) -> OpenedLog | None:
        if not (self.view or self.serve or self.rrd or self.mcap):
            if self.colour is not None:
                raise ConfigError("--colour is of --view, --serve, --rrd and --mcap: give one of these with it")
            return None
        from meshslam.viewing import LogTargets, open_run_log

        for flag, file in (("--rrd", self.rrd), ("--mcap", self.mcap)):
            if file is not None and file.resolve() == (out / "recording.rrd").resolve():
                raise ConfigError(f"{flag} {file}: the run writes this file itself when it ends: choose another")
        targets = LogTargets(self.view, self.serve, self.rrd, self.mcap, self.colour or "id")
        log = open_run_log(
            targets, overwrite=overwrite, on_failure=lambda said: print(f"note: {said}", file=sys.stderr)
        )
        if log.web_address is not None:
            print(f"serving {log.web_address}", file=sys.stderr, flush=True)
        return log


def takes_viewers(command: Callable[..., None]) -> Callable[..., None]:
    """A command whose parameter `viewers` becomes the flags of `VIEWERS`."""
    return with_flags(command, "viewers", VIEWERS, Viewers.of_flags)


def _serve_on(log: OpenedLog) -> None:
    """Wait for Ctrl-C, which then ends the command as a run without a viewer ends."""
    print(f"the run is done; {log.web_address} is served until Ctrl-C", file=sys.stderr, flush=True)
    ended = threading.Event()
    before = signal.signal(signal.SIGINT, lambda _number, _frame: ended.set())
    try:
        while not ended.wait(0.2):
            pass
    finally:
        signal.signal(signal.SIGINT, before)
