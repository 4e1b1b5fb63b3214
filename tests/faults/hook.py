"""Ends this process, or fills its disk, at the n-th step that changes a folder or makes a file last."""

import errno
import os
import pathlib
import signal

STEPS = ("replace", "rename", "fsync", "unlink", "remove", "rmdir", "link")
WRITES = ("write_bytes", "write_text", "mkdir")  # of pathlib.Path: what is not written aside first


class Hook:
    """Counts the steps; `how` is what happens at step `at`: count (nothing), kill, interrupt or full."""

    def __init__(self, at, how, count):
        self.at, self.how, self.count = at, how, count

    def install(self):
        """Put the steps of `os` and `pathlib.Path` behind the counter."""
        for name in STEPS:
            setattr(os, name, self._counted(getattr(os, name), can_fill=name not in ("unlink", "remove", "rmdir")))
        for name in WRITES:
            setattr(pathlib.Path, name, self._counted(getattr(pathlib.Path, name), can_fill=True))

    def _counted(self, step, *, can_fill):
        def counted(*arguments, **options):
            number = self.count.value = self.count.value + 1
            if self.how == "kill" and number == self.at:
                os.kill(os.getpid(), signal.SIGKILL)
            if self.how == "interrupt" and number == self.at:
                os.kill(os.getpid(), signal.SIGINT)
            if self.how == "full" and number >= self.at and can_fill:
                path = arguments[0] if arguments and not isinstance(arguments[0], int) else None
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), path and str(path))
            return step(*arguments, **options)

        return counted
