"""What Ray raises instead of an outcome: losses are repeated, an error of the node's environment is not."""

import pytest

from meshslam.fleet.jobs import Loss, Outcome
from meshslam.fleet.ray_losses import result_of

ray = pytest.importorskip("ray")


def raised(monkeypatch, error):
    def get(_reference):
        raise error

    monkeypatch.setattr("ray.get", get)
    return result_of(ray, object())


def test_an_outcome_is_handed_on(monkeypatch):
    monkeypatch.setattr("ray.get", lambda reference: reference)
    assert result_of(ray, Outcome(reason="it is damaged")) == Outcome(reason="it is damaged")


def test_losses_say_what_was_lost(monkeypatch):
    from ray import exceptions

    crashed = raised(monkeypatch, exceptions.WorkerCrashedError())
    assert (crashed.kind, crashed.text.startswith("its worker was lost (WorkerCrashedError: ")) == ("worker", True)
    node = raised(monkeypatch, exceptions.NodeDiedError("The node is dead. Node IP: 192.0.2.2, and more"))
    assert node == Loss("worker", "its node was lost (The node is dead)")
    lost = raised(monkeypatch, exceptions.ObjectLostError("0" * 56, None, ""))
    assert (lost.kind, lost.text.startswith("its result was lost with its node")) == ("worker", True)
    memory = raised(monkeypatch, exceptions.OutOfMemoryError("Task was killed"))
    assert (memory.kind, "ran out of memory" in memory.text) == ("memory", True)


def test_a_node_that_cannot_begin_is_a_reason(monkeypatch):
    from ray import exceptions

    missing = exceptions.RayTaskError("ray_work", "a trace", ModuleNotFoundError("No module named 'meshslam'"))
    outcome = raised(monkeypatch, missing)
    assert outcome.reason == "the node cannot begin the job: No module named 'meshslam'"
    broken = raised(monkeypatch, exceptions.RuntimeEnvSetupError("it cannot be set up"))
    assert "the node cannot begin the job" in broken.reason
