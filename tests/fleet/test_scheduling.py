"""Steps, retries and room, with an engine that ends jobs as it is told."""

from pathlib import Path

import pytest

from meshslam.fleet.drives import Drive, Fleet, Needs
from meshslam.fleet.jobs import Ended, Loss, Outcome
from meshslam.fleet.places import Folder
from meshslam.fleet.results import failures_first
from meshslam.fleet.scheduling import Schedule, Watch
from meshslam.runs import Config

WORKER, MEMORY = Loss("worker", "it was killed"), Loss("memory", "it was too large")
DETECTED, TRACKED = Outcome(left=("track", "map")), Outcome(left=("map",))
MAPPED = Outcome(figures={"objects_mapped": 3.0, "frames": 9.0}, seconds=2.0, peak_memory_mb=100.0, node="here")


class Told:
    """An engine with room for two; each drive's jobs end as the list says, the newest first."""

    def __init__(self, ends, room=2):
        self.ends, self.room = {name: list(rows) for name, rows in ends.items()}, room
        self.jobs, self.most, self.started, self.asked, self.looks = [], 0, [], 0, 0

    def has_room(self, needs):
        self.asked += 1
        return len(self.jobs) < self.room

    def submit(self, job):
        self.jobs.append(job)
        self.started.append((job.drive.name, job.step))
        self.most = max(self.most, len(self.jobs))

    def ended(self, timeout_s):
        job = self.jobs.pop()
        return [Ended(job, self.ends[job.drive.name].pop(0))]

    def running(self):
        self.looks += 1
        return []

    def close(self):
        self.jobs.clear()


def run(ends, tmp_path, retries=2, room=2):
    drives = tuple(Drive(name, f"drives/{name}", "map", Config()) for name in ends)
    engine, lost = Told(ends, room), []
    schedule = Schedule(
        Fleet(Path("fleet.yaml"), drives), Folder(tmp_path), engine, retries, watch=Watch(lost=lost.append)
    )
    schedule.run()
    return {result.name: result for result in schedule.results()}, engine, lost


def test_steps_follow_each_other_as_outcomes_say(tmp_path):
    results, engine, _ = run({"a": [DETECTED, TRACKED, MAPPED], "b": [TRACKED, MAPPED]}, tmp_path, room=1)
    assert engine.started == [("a", "detect"), ("a", "track"), ("a", "map"), ("b", "detect"), ("b", "map")]
    assert results["a"].how == results["b"].how == "done"
    assert (results["a"].objects, results["a"].attempts, results["a"].node) == (3.0, 1, "here")


def test_drives_that_have_begun_go_first(tmp_path):
    ends = {name: [TRACKED, MAPPED] for name in "abcdef"}
    _, engine, _ = run(ends, tmp_path)
    under_way, most = set(), 0
    for name, step in engine.started:
        under_way = under_way | {name} if step == "detect" else under_way
        most = max(most, len(under_way))
        under_way -= {name} if step == "map" else set()
    assert most <= 3


@pytest.mark.parametrize("room", [1, 2, 5])
def test_no_more_is_under_way_than_there_is_room(tmp_path, room):
    _, engine, _ = run({str(n): [TRACKED, MAPPED] for n in range(12)}, tmp_path, room=room)
    assert engine.most == room


def test_waiting_drives_cost_nothing(tmp_path):
    _, engine, _ = run({str(n): [TRACKED, MAPPED] for n in range(300)}, tmp_path)
    assert engine.asked <= 4 * len(engine.started)
    assert engine.looks <= 2  # not after every task: workers are asked for it


def test_a_step_without_room_does_not_hold_up_others(tmp_path):
    class Narrow(Told):
        def has_room(self, needs):
            return len(self.jobs) < self.room and needs.cpus <= 1

    drives = tuple(Drive(name, f"drives/{name}", "map", Config()) for name in "ab")
    engine = Narrow({"a": [TRACKED, MAPPED], "b": [TRACKED, MAPPED]}, 1)
    schedule = Schedule(
        Fleet(Path("fleet.yaml"), drives, {"map": Needs(cpus=2)}), Folder(tmp_path), engine, now_s=lambda: 0.0
    )
    with pytest.raises(IndexError):  # nothing is left that has room
        schedule.run()
    assert engine.started == [("a", "detect"), ("b", "detect")]


def test_a_lost_step_begins_again_and_no_other(tmp_path):
    results, engine, lost = run({"a": [DETECTED, WORKER, TRACKED, WORKER, MAPPED]}, tmp_path)
    assert [step for _, step in engine.started] == ["detect", "track", "track", "map", "map"]
    assert (results["a"].how, results["a"].attempts) == ("done", 3)
    assert lost == ["a: track: it was killed: again", "a: map: it was killed: again"]


@pytest.mark.parametrize("retries", [0, 1, 3])
def test_losses_are_counted(tmp_path, retries):
    results, engine, _ = run({"a": [WORKER] * 9, "b": [TRACKED, MAPPED]}, tmp_path, retries)
    assert len([name for name, _ in engine.started if name == "a"]) == retries + 1
    assert (results["a"].how, results["a"].attempts) == ("failed", retries + 1)
    assert "it was killed" in results["a"].reason
    assert results["b"].how == "done"


def test_memory_is_tried_once_more(tmp_path):
    results, _, _ = run({"a": [MEMORY, TRACKED, MAPPED], "b": [MEMORY, MEMORY]}, tmp_path, retries=5)
    assert results["a"].how == "done"
    assert results["b"].how == "failed"
    assert "it needs more memory" in results["b"].reason


def test_an_error_of_the_drive_is_not_repeated(tmp_path):
    results, engine, _ = run(
        {"a": [Outcome(reason="it is damaged")], "b": [Outcome(was_there=True, figures={})]}, tmp_path
    )
    assert engine.started == [("a", "detect"), ("b", "detect")]
    assert (results["a"].how, results["a"].reason) == ("failed", "it is damaged")
    assert results["b"].how == "unchanged"
    assert [result.name for result in failures_first([results["b"], results["a"]])] == ["a", "b"]


def test_needs_in_words():
    assert str(Needs(2.0, others={"segmenter": 1.0})) == "CPU 2, segmenter 1"
    assert Needs(0.5).threads == 1
