"""One process at a time: the living one is named, a dead one does not count."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from meshslam.errors import MapError
from meshslam.files import LOCK, locked
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
