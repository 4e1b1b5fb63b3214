"""The whole training in small: drawn, learnt, cut short and taken up again, exported, and found by the runtime."""

import numpy as np
import pytest

from meshslam.perception import KeypointConfig, KeypointFinder
from meshslam.perception.keypoints.crop import to_input
from tests.cli.conftest import meshslam

torch = pytest.importorskip("torch", reason="the extra `train` is not installed")

from meshslam.training.pictures import Album, draw_chunk, samples_of  # noqa: E402
from meshslam.training.train import TrainingConfig, evaluate, export, held_out, learn  # noqa: E402

SMALL = TrainingConfig(epochs=3, restart_epochs=1, batch=8)


@pytest.fixture(scope="module")
def album():
    return Album(draw_chunk(5, 24, 2))


@pytest.fixture(scope="module")
def network(album, tmp_path_factory):
    return learn(album, SMALL, tmp_path_factory.mktemp("whole") / "checkpoint.pt")


def weights(network):
    return torch.cat([p.detach().flatten() for p in network.parameters()]).numpy()


def test_a_training_that_was_cut_short_ends_with_the_same_weights(album, network, tmp_path):
    def report(task, done, total):
        if task.startswith("epoch 3") and done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        learn(album, SMALL, tmp_path / "checkpoint.pt", report)
    again = learn(album, SMALL, tmp_path / "checkpoint.pt")
    assert np.array_equal(weights(again), weights(network))


def test_the_exported_network_answers_as_the_trained_one(album, network, tmp_path):
    export(network, tmp_path / "network.onnx")
    finder = KeypointFinder(KeypointConfig(model=str(tmp_path / "network.onnx"), threads=1))
    samples = samples_of(np.random.default_rng(2), album, range(9))
    crops = to_input(samples.cuts)
    ours = [answer.detach().numpy() for answer in network.eval()(torch.from_numpy(crops))]
    for mine, theirs in zip(ours, finder._session.run(None, {"crops": crops}), strict=True):
        assert np.allclose(mine, theirs, atol=1e-3)


def test_the_learning_rate_falls_to_nothing_twice(tmp_path, album, monkeypatch):
    rates = []

    class Recorded(torch.optim.AdamW):
        def step(self, *given):
            rates.append(self.param_groups[0]["lr"])
            return super().step(*given)

    monkeypatch.setattr(torch.optim, "AdamW", Recorded)
    learn(album, TrainingConfig(epochs=3, restart_epochs=2, batch=8), tmp_path / "checkpoint.pt")
    steps = len(album) // 8
    first, second = np.array(rates[: 3 * steps]), np.array(rates[3 * steps + 1 :])
    assert first.max() > 1e-3 > 0.3 * first.max() > first[-1]
    assert second[0] == pytest.approx(1e-3 * (1 - 1 / (2 * steps)))
    assert np.diff(second) == pytest.approx(np.full(len(second) - 1, -1e-3 / (2 * steps)))


def test_what_is_learnt_by_heart_is_known(album, tmp_path):
    """Enough passes over a few pictures: the loss and the labels belong together."""
    network = learn(album, TrainingConfig(epochs=80, batch=8, warm_up=0.2), tmp_path / "checkpoint.pt")
    known = evaluate(network, samples_of(np.random.default_rng(7), album, range(len(album))))
    assert known.pck > 0.6
    assert known.angle_median_deg < 20


def test_cars_and_a_fleet_are_learnt_together_and_scored_apart(album, tmp_path):
    """The first chunks of each are kept; a fleet keeps as large a share as the cars, at least one chunk."""
    config = TrainingConfig(chunks=3, fleet_chunks=2, held_out_chunks=1)
    paths = [tmp_path / f"{i}.npz" for i in range(5)]
    for path in paths:
        np.savez(path, **vars(album._pictures))
    learnt, kept = held_out(paths[:3], paths[3:], config)
    assert len(learnt) == 3 * len(album)
    assert {kind: len(samples) for kind, samples in kept.items()} == {"cars": len(album), "fleet": len(album)}
    assert not np.array_equal(kept["cars"].cuts, kept["fleet"].cuts)  # each in a way of its own


def test_the_command_draws_learns_exports_and_says_how_good_it_is(tmp_path):
    arguments = ["train-keypoints", "--out", str(tmp_path), "--chunks", "2", "--chunk-size", "32", "--held-out", "1"]
    done = meshslam(*arguments, "--fleet-chunks", "0", "--epochs", "2", "--restart-epochs", "1")
    assert done.returncode == 0, done.stderr
    assert "pck: " in done.stdout
    KeypointFinder(KeypointConfig(model=str(tmp_path / "car_keypoints.onnx"), threads=1))
