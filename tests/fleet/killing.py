"""Workers and nodes that are killed while they are at work on a drive."""

import contextlib
import json
import os
import signal
import time
from pathlib import Path

from meshslam.files import LOCK


def writers(out):
    """Drives that are being written, with the process that does."""
    found = {}
    for lock in (out / "runs").glob(f"*/{LOCK}"):
        try:
            found[lock.parent.name] = json.loads(lock.read_text())["pid"]
        except (OSError, ValueError, KeyError):  # it is being written
            continue
    return found


def parent_of(pid):
    """None if the process has ended."""
    try:
        state, parent = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[:2]
    except OSError:
        return None
    return None if state in "ZX" else int(parent)


def halted_in_the_middle(out, chosen, raylet=None):
    """A drive whose worker was halted while it was at work, with its process; with a raylet, one of its workers."""
    for name, pid in writers(out).items():
        if name not in chosen or parent_of(pid) is None or raylet not in (None, parent_of(pid)):
            continue
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGSTOP)
            if writers(out).get(name) == pid:
                return name, pid
            os.kill(pid, signal.SIGCONT)
    return None


def kill(pid, raylet=None):
    """End a worker; with a raylet, all of its node."""
    for process in [pid] if raylet is None else [raylet, *children_of(raylet)]:
        os.kill(process, signal.SIGKILL)
    while parent_of(pid) is not None:
        time.sleep(0.002)


def killed_in_the_middle(out, chosen, raylet=None):
    """The drive whose worker was killed while it was at work; with a raylet, one of its workers, and all of the node.

    A worker is halted first, so that it is sure to be in the middle.
    """
    found = halted_in_the_middle(out, chosen, raylet)
    if found is None:
        return None
    kill(found[1], raylet)
    return found[0]


def children_of(parent):
    numbers = [int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit()]
    return [number for number in numbers if parent_of(number) == parent]


def environment_of(pid):
    """What a process was started with."""
    return Path(f"/proc/{pid}/environ").read_bytes().decode().split("\0")


def raylets():
    """Ray's processes of nodes on this machine."""
    found = set()
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            if b"raylet/raylet" in path.read_bytes().split(b"\0")[0]:
                found.add(int(path.parent.name))
    return found


def raylet_of(node):
    return node.all_processes["raylet"][0].process.pid
