"""One process at a time: the living one is named, a dead one does not count."""

import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from meshslam.errors import MapError
from meshslam.files import LOCK, locked, wait_until_free
from meshslam.files.lock import started

HOLDER = """
import sys
from pathlib import Path
from meshslam.files import locked
with locked(Path(sys.argv[1]), "run"):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def path(tmp_path):
    return tmp_path / LOCK


def test_the_lock_is_there_while_the_block_runs(path):
    with locked(path, "run"):
        assert json.loads(path.read_text())["pid"] == os.getpid()
    assert not path.exists()
    with pytest.raises(ValueError, match="inside"), locked(path, "run"):
        raise ValueError("inside")
    assert not path.exists()


def test_another_process_is_refused_by_number_until_it_ends(path):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", HOLDER, path], env=environment, **pipes) as holder:
        assert holder.stdout.readline() == b"held\n"
        with pytest.raises(MapError, match=f"run: process {holder.pid} is writing it"), locked(path, "run"):
            pass
        assert path.exists()
        holder.kill()
        holder.wait()
        assert path.exists()
        with locked(path, "run"):
            assert json.loads(path.read_text())["pid"] == os.getpid()


@pytest.mark.parametrize("content", ["", "{", "[]", '{"pid": "x"}', '{"pid": 4194305, "started": "1"}'])
def test_a_lock_without_a_living_process_is_taken_over(path, content):
    path.write_text(content)
    with locked(path, "run"):
        assert json.loads(path.read_text())["pid"] == os.getpid()


def test_a_process_that_began_later_under_the_same_number_is_another(path):
    path.write_text(json.dumps({"pid": os.getppid(), "started": "long ago"}))
    with locked(path, "run"):
        pass
    path.write_text(json.dumps({"pid": os.getppid(), "started": started(os.getppid())}))
    with pytest.raises(MapError, match=str(os.getppid())), locked(path, "run"):
        pass


@pytest.fixture
def elsewhere(path, monkeypatch):
    """A lock that a process of another machine has, or had."""
    monkeypatch.setattr("meshslam.files.lock.PATIENCE_S", 1.0)
    path.write_text(json.dumps({"pid": 1, "started": started(1), "host": "far", "space": "pid:[1]"}))
    return path


def test_a_lock_of_another_machine_that_is_not_touched_is_taken_over(elsewhere):
    with locked(elsewhere, "run"):
        assert json.loads(elsewhere.read_text())["pid"] == os.getpid()


def test_a_lock_of_another_machine_that_is_touched_is_held(elsewhere):
    ended = threading.Event()

    def touch():
        while not ended.wait(0.1):
            os.utime(elsewhere)

    thread = threading.Thread(target=touch)
    thread.start()
    try:
        with pytest.raises(MapError, match="run: process 1 on far is writing it"), locked(elsewhere, "run"):
            pass
    finally:
        ended.set()
        thread.join()


def test_a_lock_that_was_taken_over_is_not_removed(path):
    with locked(path, "run"):
        path.write_text(json.dumps({"pid": 1, "started": "x", "host": "far", "space": ""}))
    assert json.loads(path.read_text())["pid"] == 1


def test_a_lock_is_touched_while_it_is_held(path, monkeypatch):
    monkeypatch.setattr("meshslam.files.lock.BEAT_S", 0.05)
    with locked(path, "run"):
        first = path.stat().st_mtime_ns
        time.sleep(0.5)
        assert path.stat().st_mtime_ns > first


def test_waiting_ends_with_the_holder_or_with_patience(path):
    wait_until_free(path)
    path.write_text(json.dumps({"pid": os.getppid(), "started": started(os.getppid())}))
    began_s = time.monotonic()
    wait_until_free(path, 0.5)
    assert 0.4 < time.monotonic() - began_s < 10
    path.write_text(json.dumps({"pid": os.getppid(), "started": "long ago"}))
    wait_until_free(path, 1e9)


def test_an_interrupt_at_its_removal_leaves_no_lock(path, monkeypatch):
    remove, calls = Path.unlink, []

    def interrupted(self, missing_ok=False):
        calls.append(self)
        if len(calls) == 1:
            raise KeyboardInterrupt
        remove(self, missing_ok=missing_ok)

    monkeypatch.setattr(Path, "unlink", interrupted)
    with pytest.raises(KeyboardInterrupt), locked(path, "run"):
        pass
    assert not path.exists()
