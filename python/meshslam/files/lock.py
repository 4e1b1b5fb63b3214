"""One process at a time in a folder: a lock file that names its process, and that a dead process does not keep.

Whether a process of this machine lives is looked up. One of another machine, or of another container, shows that it
lives: it touches its lock now and then.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
import threading
import time
from collections.abc import Iterator, Mapping
from io import FileIO
from pathlib import Path

from meshslam.errors import MapError, MeshslamError

try:
    import fcntl
except ImportError:  # Windows: two that come in the same instant are not told apart there
    fcntl = None  # type: ignore[assignment]

LOCK = ".meshslam-lock"
BEAT_S = 3.0  # between touches of a lock that is held
PATIENCE_S = 12.0  # with one of another machine that is not touched


@contextlib.contextmanager
def locked(path: Path, what: str, error: type[MeshslamError] = MapError) -> Iterator[None]:
    """Hold the lock file `path` while the block runs; `error` names the process that holds it, if one does.

    A lock whose process has ended, or whose number another process has now, is taken over.
    """
    holder = _take(path, error)
    if holder is not None:
        where = "" if _is_here(holder) else f" on {holder['host']}"
        raise error(
            f"{what}: process {holder['pid']}{where} is writing it: wait for it, or choose another folder "
            f"(its lock is {path.name})"
        )
    try:
        with _touched(path):
            yield
    finally:
        _release(path)


@contextlib.contextmanager
def _touched(path: Path) -> Iterator[None]:
    """Touch a lock now and then while the block runs, for processes that cannot look this one up."""
    ended = threading.Event()

    def touch() -> None:
        while not ended.wait(BEAT_S):
            with contextlib.suppress(OSError):
                os.utime(path)

    threading.Thread(target=touch, daemon=True, name="meshslam-lock").start()
    try:
        yield
    finally:
        ended.set()


def wait_until_free(path: Path, up_to_s: float = 30.0) -> None:
    """Wait while a living process holds a lock, but no longer than that: one that was killed may still be ending."""
    end_s = time.monotonic() + up_to_s
    while time.monotonic() < end_s:
        try:
            holder = _holder(path.read_bytes(), path)
        except OSError:
            return
        if holder is None:
            return
        time.sleep(0.1)


def _release(path: Path) -> None:
    """Remove the lock, even if Ctrl-C comes at that moment."""
    with contextlib.suppress(OSError):
        try:
            _remove_own(path)
        except OSError:
            raise
        except BaseException:  # what the command makes of SIGINT
            _remove_own(path)
            raise


def _remove_own(path: Path) -> None:
    """Remove the lock, unless another machine has taken it over meanwhile."""
    with contextlib.suppress(ValueError, KeyError, TypeError):
        found = json.loads(path.read_bytes())
        if found["pid"] != os.getpid() or not _is_here(found):
            return
    path.unlink(missing_ok=True)


def _take(path: Path, error: type[MeshslamError]) -> dict[str, object] | None:
    """Write this process into the lock file; the living process that is in there, if one is."""
    while True:
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as problem:
            raise error(f"{path.parent}: cannot be written: {problem.strerror}") from None
        with os.fdopen(handle, "r+b", buffering=0) as file:
            _alone(file.fileno())
            if not _is_current(file.fileno(), path):
                continue  # its holder has just removed it
            holder = _holder(file.read(), path)
            if holder is not None:
                return holder
            _write(file, path, error)
            return None


def _write(file: FileIO, path: Path, error: type[MeshslamError]) -> None:
    """Put this process into the lock file; `error` names the file if the disk does not take it."""
    content = json.dumps({"pid": os.getpid(), "started": started(os.getpid()), **_here()}).encode()
    try:
        file.seek(0)
        file.truncate()
        while content:
            content = content[file.write(content) :]
    except OSError as problem:
        path.unlink(missing_ok=True)
        raise error(f"{path}: cannot be written: {problem.strerror}") from None


def _alone(handle: int) -> None:
    """Look and write without another doing so between; the system lets go when the file is closed."""
    if fcntl is not None:
        with contextlib.suppress(OSError):  # a file system without this
            fcntl.flock(handle, fcntl.LOCK_EX)


def _is_current(handle: int, path: Path) -> bool:
    """Whether the open file is still the one of that name."""
    with contextlib.suppress(OSError):
        return os.path.samestat(os.fstat(handle), path.stat())
    return False


def _holder(content: bytes, path: Path) -> dict[str, object] | None:
    """The process of a lock file, if it lives; a lock that was cut short has none."""
    try:
        found = dict(json.loads(content))
        pid = int(found["pid"])
    except (ValueError, KeyError, TypeError):
        return None
    if not _is_here(found):
        return found if _is_touched(path) else None
    alive = started(pid)
    return found if alive is not None and alive == found.get("started") else None


def _here() -> dict[str, str]:
    """Where process numbers are those that this process sees: a machine, or a container."""
    space = "/proc/self/ns/pid"
    return {"host": socket.gethostname(), "space": str(Path(space).readlink()) if os.path.lexists(space) else ""}


def _is_here(holder: Mapping[str, object]) -> bool:
    """Whether a holder can be looked up; versions before did not say where they are."""
    return "host" not in holder or all(holder.get(name) == value for name, value in _here().items())


def _is_touched(path: Path) -> bool:
    """Whether a lock is touched while we watch; it is opened each time, as network file systems remember times."""
    first_ns, end_s = _touched_ns(path), time.monotonic() + PATIENCE_S
    while first_ns is not None and time.monotonic() < end_s:
        time.sleep(0.2)
        now_ns = _touched_ns(path)
        if now_ns != first_ns:
            return now_ns is not None
    return False


def _touched_ns(path: Path) -> int | None:
    with contextlib.suppress(OSError), path.open("rb") as file:
        return os.fstat(file.fileno()).st_mtime_ns
    return None


def started(pid: int) -> str | None:
    """When a process began, in words that no other process of its number has; None if there is none."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return None if Path("/proc/self/stat").exists() else _started_by_ps(pid)
    rest = text.rpartition(")")[2].split()  # a name may hold spaces and brackets
    boot = Path("/proc/sys/kernel/random/boot_id")
    return None if rest[0] in "ZX" else f"{rest[19]} {boot.read_text().strip() if boot.exists() else ''}"


def _started_by_ps(pid: int) -> str | None:
    """The same where there is no /proc."""
    shown = subprocess.run(["ps", "-o", "lstart=", "-p", str(pid)], capture_output=True, text=True, check=False)
    return shown.stdout.strip() or None
