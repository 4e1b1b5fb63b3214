"""What the node saves is whole, whenever it is killed."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from meshslam.errors import MapError
from meshslam.geometry import Pose
from meshslam.maps import Map, Trajectory
from meshslam.ros2.saving import LivePath, Saving
from meshslam.runs import Config
from tests.ros2.harness import environment

SAVES = """
import sys
from dataclasses import replace
from pathlib import Path
import numpy as np
from meshslam.categories import load_category
from meshslam.geometry import Pose
from meshslam.maps import Map, MapObject, Trajectory
from meshslam.ros2.saving import Saving
from meshslam.runs import Config

car, k = load_category("car"), 0
with Saving(Path(sys.argv[1]), Config(), "slam", overwrite=True) as saving:
    print("ready", flush=True)
    while True:
        k += 1
        poses = tuple(Pose(np.eye(3), np.array([k, i, 0.0])) for i in range(k % 7 + 1))
        places = [Pose(np.eye(3), np.array([float(k), 5.0 * i, 0.0])) for i in range(k % 5 + 1)]
        things = tuple(MapObject(i, "car", p, car.vertices, car.faces) for i, p in enumerate(places))
        saving.save(Map(things), Trajectory(np.arange(float(len(poses))), poses))
        print("saved", k, flush=True)
"""


def path_of(count):
    return Trajectory(np.arange(float(count)), tuple(Pose(np.eye(3), np.array([k, 0.0, 0.0])) for k in range(count)))


def test_a_killed_process_leaves_a_whole_map(tmp_path, rng):
    run, counts = tmp_path / "run", []
    for _ in range(4):
        command = [sys.executable, "-c", SAVES, str(run)]
        process = subprocess.Popen(command, env=environment(1, tmp_path), stdout=subprocess.PIPE, text=True)
        while not process.stdout.readline().startswith("saved 2"):
            assert process.poll() is None
        time.sleep(float(rng.uniform(0.0, 0.15)))
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        process.stdout.close()
        scene, path = Map.load(run), Trajectory.load(run / "trajectory.tum")
        rounds = {round(float(thing.world_from_object.translation[0])) for thing in scene.objects}
        (k,) = rounds  # all objects are of one save
        assert len(scene) == k % 5 + 1
        assert len(path) >= 1
        counts.append(k)
    assert max(counts) > 2


def test_after_each_change_of_a_name_the_old_map_or_the_new_one_is_whole(tmp_path, car, monkeypatch):
    """So that a kill between any two of them loses nothing."""
    run, seen = tmp_path / "run", []
    other = replace(car, id=9)

    def watched(change):
        def changed(self, *given, **told):
            result = change(self, *given, **told)
            scene = Map.load(run)
            seen.append(tuple(scene))
            return result

        return changed

    with Saving(run, Config(), "slam", overwrite=False) as saving:
        saving.save(Map((car,)), path_of(1))
        for name in ("replace", "unlink", "rename", "rmdir"):
            monkeypatch.setattr(Path, name, watched(getattr(Path, name)))
        for k, things in enumerate([(car, other), (other,), (car, other), (), (car,)]):
            saving.save(Map(things), path_of(k + 2))
            assert sorted(seen[-1]) == sorted(thing.id for thing in things)
        monkeypatch.undo()
    assert len(seen) > 20


def test_a_map_that_is_there_is_not_replaced_unless_asked(tmp_path, car):
    with Saving(tmp_path / "run", Config(), "slam", overwrite=False) as saving:
        saving.save(Map((car,)), path_of(3))
    with pytest.raises(MapError, match="there already: choose another --out, or --overwrite it"):
        Saving(tmp_path / "run", Config(), "slam", overwrite=False).__enter__()
    with Saving(tmp_path / "run", Config(), "slam", overwrite=True) as saving:
        assert len(Map.load(tmp_path / "run")) == 1  # until the first save
        saving.save(Map(()), path_of(1))
    assert len(Map.load(tmp_path / "run")) == 0


def test_two_nodes_do_not_write_one_folder(tmp_path):
    command = [sys.executable, "-c", SAVES, str(tmp_path / "run")]
    process = subprocess.Popen(command, env=environment(1, tmp_path), stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "ready\n"
        with pytest.raises(MapError, match=f"process {process.pid} is writing it"):
            Saving(tmp_path / "run", Config(), "slam", overwrite=True).__enter__()
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def test_a_foreign_folder_stays_as_it_is(tmp_path):
    (tmp_path / "letters.txt").write_text("mine")
    with pytest.raises(MapError, match=r"is no run directory but holds letters\.txt"):
        Saving(tmp_path, Config(), "slam", overwrite=True).__enter__()


def test_the_path_has_each_time_once_and_in_order():
    path = LivePath()
    for t in (0.0, 0.1, 0.1, 0.05, 0.2):
        path.add(t, Pose.identity())
    np.testing.assert_array_equal(path.trajectory().times_s, [0.0, 0.1, 0.2])
    path.forget()
    assert len(path) == 0
