import os
import resource
import signal
import subprocess
import sys
import time

import pytest

from meshslam.errors import MapError
from meshslam.files import LEFTOVER_SUFFIX, remove_leftovers, write_atomically, write_together
from meshslam.maps import Map

WRITER = """
import sys
from pathlib import Path
from meshslam.files import write_atomically
path, size = Path(sys.argv[1]), int(sys.argv[2])
print("ready", flush=True)
for i in range(10**9):
    write_atomically(path, bytes([65 + i % 26]) * size)
"""

MAP_WRITER = """
import sys
from pathlib import Path
import numpy as np
from meshslam.geometry import Pose
from meshslam.maps import Map, MapObject
triangle, face = np.array([[-1.0, -1, -1], [1, 1, 1], [1, -1, 0]]), np.array([[0, 1, 2]])
print("ready", flush=True)
for i in range(10**9):
    scale = 1.0 + i % 7
    things = [MapObject(n, str(scale), Pose.identity(), scale * triangle, face) for n in range(8)]
    Map(tuple(things)).save(Path(sys.argv[1]))
"""


def kill_while_writing(code, folder, *arguments):
    """Kill the program when a file in the folder is half written, or soon after."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "OMP_NUM_THREADS": "1"}
    with subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)], stdout=subprocess.PIPE, env=environment
    ) as process:
        assert process.stdout.readline() == b"ready\n"
        before, end = set(leftovers(folder)), time.monotonic() + 10
        while not set(leftovers(folder)) - before and time.monotonic() < end:
            pass
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL


def leftovers(folder):
    return list(folder.rglob(f".*{LEFTOVER_SUFFIX}"))


def test_killed_while_writing_a_file_is_whole(tmp_path):
    size = 4_000_000
    for count in range(100):
        kill_while_writing(WRITER, tmp_path, tmp_path / "map.json", size)
        if (tmp_path / "map.json").exists():
            content = (tmp_path / "map.json").read_bytes()
            assert len(content) == size
            assert content == content[:1] * size
        if count >= 3 and leftovers(tmp_path) and (tmp_path / "map.json").exists():
            break
    assert leftovers(tmp_path)  # it was in the middle of writing
    remove_leftovers(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["map.json"]


def test_killed_while_saving_a_map_its_files_belong_together(tmp_path):
    for count in range(100):
        kill_while_writing(MAP_WRITER, tmp_path, tmp_path)
        if (tmp_path / "map.json").exists():
            things = Map.load(tmp_path).objects
            assert len({thing.category for thing in things}) == 1
            for thing in things:
                assert thing.dimensions[0] == pytest.approx(2 * float(thing.category))
        if count >= 3 and leftovers(tmp_path) and (tmp_path / "map.json").exists():
            break
    remove_leftovers(tmp_path)
    assert not leftovers(tmp_path)


@pytest.fixture
def small_disk():
    """No file over 100 kB can be written, as on a full disk."""
    before, handler = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
    signal.signal(signal.SIGXFSZ, handler)


def test_a_full_disk_leaves_the_old_file_and_nothing_else(tmp_path, small_disk):
    path = tmp_path / "map.json"
    write_atomically(path, b"old")
    with pytest.raises(MapError, match=r"map\.json: cannot be written: File too large"):
        write_atomically(path, b"x" * 200_000)
    with pytest.raises(MapError, match=r"3\.ply: cannot be written"):
        write_together({path: b"new", tmp_path / "3.ply": b"x" * 200_000}, path)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {"map.json": b"old"}


def test_an_interrupt_while_a_file_is_written_leaves_the_old_one_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "file"
    write_atomically(path, b"old")

    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr("meshslam.files.atomic.os.fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_atomically(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(MapError, match=r"nowhere/map\.json: cannot be written: No such file"):
        write_atomically(tmp_path / "nowhere" / "map.json", b"")


def test_files_are_readable_as_others_are(tmp_path):
    (tmp_path / "plain").write_bytes(b"")
    write_atomically(tmp_path / "atomic", b"")
    assert (tmp_path / "atomic").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_only_our_leftovers_are_removed(tmp_path):
    (tmp_path / "objects").mkdir()
    kept = [tmp_path / ".hidden", tmp_path / "a.tmp", tmp_path / f"mine{LEFTOVER_SUFFIX}"]
    gone = [tmp_path / f".map.json.7{LEFTOVER_SUFFIX}", tmp_path / "objects" / f".3.ply.7{LEFTOVER_SUFFIX}"]
    for path in kept + gone:
        path.write_text("")
    remove_leftovers(tmp_path)
    assert [p.exists() for p in kept] == [True] * 3
    assert [p.exists() for p in gone] == [False] * 2
