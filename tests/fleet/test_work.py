"""A job in a worker: outcomes instead of exceptions, and the engines' room."""

import os
import signal
import subprocess
import sys
import threading
import time
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from meshslam.errors import MapError
from meshslam.files import LOCK
from meshslam.fleet.cluster import Cluster
from meshslam.fleet.drives import Drive, Needs
from meshslam.fleet.jobs import Job, Loss, Outcome, Running
from meshslam.fleet.processes import Processes
from meshslam.fleet.throttle import throttled
from meshslam.fleet.work import thread_settings, work
from meshslam.runs import Config, InputConfig, Step
from tests.fleet.killing import environment_of

HOLDER = """
import sys, time
from pathlib import Path
from types import SimpleNamespace
from meshslam.files import locked
with locked(Path(sys.argv[1]), "run"):
    print("held", flush=True)
    time.sleep(60)
"""


def job(tmp_path, name="a", **more):
    drive = Drive(name, str(tmp_path / "missing"), "map", Config(input=InputConfig(sequence=str(tmp_path / "missing"))))
    return Job(drive, "detect", Needs(), version("meshslam"), str(tmp_path / name), **more)


def silent(_doing, _done, _total):
    return


@pytest.fixture
def step(monkeypatch):
    """What the step of the run does: what is put into it is called or raised, or given."""
    done = []

    def run_step(*given, overwrite):
        done.append(overwrite)
        found = step.does.pop(0) if len(step.does) > 1 else step.does[0]
        if isinstance(found, BaseException):
            raise found
        return found() if callable(found) else found

    monkeypatch.setattr("meshslam.runs.run_step", run_step)
    step.done, step.does = done, [Step(("map",))]
    return step


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (MapError("out: it is damaged"), "out: it is damaged"),
        (SystemExit(3), "SystemExit: 3: a fault of meshslam"),
        (MemoryError(), "out of memory"),
        (OSError(28, "No space left", "/out/map.json"), "/out/map.json: No space left"),
        (ValueError("two\nlines"), "ValueError: two lines: a fault of meshslam"),
    ],
)
def test_whatever_is_raised_is_the_reason(step, tmp_path, error, reason):
    step.does = [error]
    outcome = work(job(tmp_path), silent)
    assert outcome.reason.startswith(reason)
    assert ("Traceback" in outcome.fault) == ("fault" in outcome.reason)


def test_ctrl_c_is_raised(step, tmp_path):
    step.does = [KeyboardInterrupt()]
    with pytest.raises(KeyboardInterrupt):
        work(job(tmp_path), silent)


def test_a_run_that_is_as_it_should_be_is_not_overwritten(step, tmp_path):
    assert work(job(tmp_path, overwrite=True), silent).left == ("map",)
    assert step.done == [False]
    step.does = [MapError("another is here"), Step(("map",))]
    assert work(job(tmp_path, overwrite=True), silent).left == ("map",)
    assert step.done == [False, False, True]
    step.does = [MapError("another is here")]
    assert work(job(tmp_path), silent).reason == "another is here"


def test_another_version_is_refused(step, tmp_path):
    from dataclasses import replace

    outcome = work(replace(job(tmp_path), version="0.0.1"), silent)
    assert "the fleet is run by 0.0.1" in outcome.reason
    assert step.done == []


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="Linux alone can forget the peak")
def test_the_peak_of_memory_is_that_of_the_job(step, tmp_path):
    step.does = [lambda: Step((), {"filled": float(np.ones(40_000_000).sum())}), Step(())]
    large, small = work(job(tmp_path), silent), work(job(tmp_path), silent)
    assert large.peak_memory_mb > small.peak_memory_mb + 200


def test_a_worker_before_this_one_may_still_be_dying(step, tmp_path):
    out = tmp_path / "a"
    out.mkdir()
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, out / LOCK], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as old:
        assert old.stdout.readline() == b"held\n"
        timer = threading.Timer(1.0, old.kill)
        timer.start()
        step.does = [lambda: Step(()) if old.poll() is not None else pytest.fail("it did not wait")]
        assert work(job(tmp_path), silent).reason == ""


def test_threads_are_set_for_every_library():
    assert thread_settings(3) == {"OMP_NUM_THREADS": "3", "OPENBLAS_NUM_THREADS": "1", "RAYON_NUM_THREADS": "3"}


def test_progress_is_told_now_and_then():
    told, now_s = [], [0.0]
    tell = throttled(lambda *row: told.append(row), 1.0, lambda: now_s[0])
    for done in range(30):
        now_s[0] = done / 10
        tell("segment", done, 30)
    tell("track", 0, 30)
    assert told == [("segment", 0, 30), ("segment", 10, 30), ("segment", 20, 30), ("track", 0, 30)]


def waited(engine):
    end_s = time.monotonic() + 60
    while time.monotonic() < end_s:
        for ended in engine.ended(0.5):
            return ended
    raise AssertionError("nothing has ended")


def test_a_process_that_is_lost_takes_no_other_with_it(tmp_path):
    engine = Processes(2)
    try:
        assert engine.has_room(Needs())
        engine.submit(job(tmp_path, "a"))
        assert engine.has_room(Needs())
        engine.submit(job(tmp_path, "b"))
        assert not engine.has_room(Needs())
        assert {f"{k}={v}" for k, v in thread_settings(1).items()} <= set(environment_of(engine._all[0].process.pid))
        os.kill(next(w.process.pid for w in engine._all if w.job.drive.name == "a"), signal.SIGKILL)
        ended = {e.job.drive.name: e.result for e in (waited(engine), waited(engine))}
        assert isinstance(ended["a"], Loss)
        assert "was killed by SIGKILL" in ended["a"].text
        assert "no such folder" in ended["b"].reason
        engine.submit(job(tmp_path, "c"))  # the living one takes it
        assert len(engine._all) == 1
        assert isinstance(waited(engine).result, Outcome)
    finally:
        engine.close()
    assert engine._all == []


def test_this_machine_takes_what_its_cpus_hold(tmp_path):
    from dataclasses import replace

    engine = Processes(None, cpus=2.0)
    try:
        assert engine.has_room(Needs(cpus=99.0))
        engine.submit(replace(job(tmp_path, "a"), needs=Needs(cpus=1.5)))
        assert engine.has_room(Needs(cpus=0.5))
        assert not engine.has_room(Needs())
        waited(engine)
        engine.submit(replace(job(tmp_path, "b"), needs=Needs(cpus=2.0)))
        assert len(engine._all) == 1  # one of other threads took its place
        assert not engine.has_room(Needs(cpus=0.5))
    finally:
        engine.close()


class SomeRay:
    """A module that takes tasks, of which the last ones end first, and has nodes."""

    def __init__(self, *cpus):
        self.cpus, self.tasks, self.every_s = cpus, [], []

    def nodes(self):
        return [{"Alive": True, "Resources": {"CPU": count}} for count in self.cpus]

    def remote(self, _function):
        return self

    def options(self, **_options):
        return SimpleNamespace(remote=self.submit)

    def submit(self, _job, _board, every_s):
        self.tasks.append(len(self.tasks))
        self.every_s.append(every_s)
        return self.tasks[-1]

    def wait(self, references, num_returns, timeout):
        return sorted(references)[-num_returns:], []

    def get(self, reference):
        return Outcome(reason=str(reference))

    exceptions = SimpleNamespace(
        **dict.fromkeys(
            ("OutOfMemoryError", "RayTaskError", "RuntimeEnvSetupError", "NodeDiedError", "ObjectLostError"), OSError
        )
    )


def test_a_cluster_takes_what_its_cpus_hold(tmp_path):
    from dataclasses import replace

    engine = Cluster(None, SomeRay(2.0, 1.0), None)
    assert engine.has_room(Needs(cpus=99.0))  # nodes may come for it
    for _ in range(2):
        engine.submit(job(tmp_path))
    assert engine.has_room(Needs())
    assert not engine.has_room(Needs(cpus=2.0))
    engine.submit(replace(job(tmp_path), needs=Needs(cpus=0.5)))
    assert not engine.has_room(Needs())
    engine.workers = 4
    assert engine.has_room(Needs())
    engine.submit(job(tmp_path))
    assert not engine.has_room(Needs())
    engine.workers = None
    assert sorted(ended.result.reason for ended in engine.ended(1.0)) == ["0", "1", "2", "3"]  # all that have ended
    engine.submit(replace(job(tmp_path), needs=Needs(cpus=3.0)))
    assert not engine.has_room(Needs(cpus=0.5))


def test_many_workers_tell_less_often(tmp_path):
    ray = SomeRay(1.0)
    engine = Cluster(4000, ray, None)
    for _ in range(4001):
        engine.submit(job(tmp_path))
    assert (ray.every_s[0], ray.every_s[400], ray.every_s[4000]) == (1.0, 1.0, 10.0)


def test_what_is_running_is_told_by_the_worker():
    from meshslam.fleet.board import Board

    board = Board()
    board.tell(Running("a", "detect", "segment", 3, 9))
    board.tell(Running("a", "detect", "segment", 5, 9))
    board.tell(Running("b", "track"))
    board.tell(Running("b", "map"))
    board.forget("b", "track")  # a word of the step after may come before it
    assert board.rows() == {"a": Running("a", "detect", "segment", 5, 9), "b": Running("b", "map")}
    board.forget("b", "map")
    assert list(board.rows()) == ["a"]
