"""Command line: one thin file a command; the only room that prints or exits."""

from __future__ import annotations

import os
import sys


def main() -> None:
    """Run `meshslam`. Ctrl-C while the commands are being imported ends it as it does later."""
    try:
        from meshslam.cli.app import main as run
    except KeyboardInterrupt:
        print("interrupted: nothing was begun", file=sys.stderr, flush=True)
        os._exit(130)
    run()


__all__ = ["main"]
