"""Training of the key point network: draw, learn, export."""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from meshslam.errors import ModelError
from meshslam.files import remove_leftovers_of, write_atomically
from meshslam.geometry import Singles
from meshslam.perception import Answers, answers_of, to_input
from meshslam.settings import Settings, setting
from meshslam.training.augment import varied
from meshslam.training.dataset import Samples
from meshslam.training.losses import total_loss
from meshslam.training.network import KeypointNetwork
from meshslam.training.pictures import CHUNK, Album, load_album, samples_of
from meshslam.training.score import Score, score

Report = Callable[[str, int, int], None]
OUTPUTS = ("heat", "visible", "log_sigma", "angle")
OPSET = 17
HELD_OUT = 2**32 - 1  # beside the seed: where the random numbers of the held-out samples start


@dataclass(frozen=True)
class TrainingConfig(Settings):
    """What decides the weights."""

    seed: int = setting(1, low=0)
    chunks: int = setting(35, low=1)  # of cars
    fleet_chunks: int = setting(14, low=0)  # of vans, trucks, buses and cars together
    chunk_size: int = setting(CHUNK, low=1)  # pictures
    held_out_chunks: int = setting(5, low=0)  # of the cars'; of the fleet's as many in proportion
    epochs: int = setting(9, low=1)
    horizon: float = setting(4 / 3, above=0)  # of the epochs: one rise and fall of the learning rate
    cool_down: float = setting(5 / 9, above=0)  # of the epochs, the last ones, in which it also fades out in a line
    restart_epochs: int = setting(4, low=0)  # more epochs (warm restart: Loshchilov and Hutter 2017)
    restart_rate: float = setting(1e-3, above=0)  # the learning rate that falls to 0 in a line over them
    batch: int = setting(32, low=1)
    learning_rate: float = setting(3e-3, above=0)  # at its peak
    weight_decay: float = setting(1e-3, low=0)
    warm_up: float = setting(0.1, above=0, below=1)  # share of the horizon

    @property
    def held_out_fleet_chunks(self) -> int:
        """How many of the fleet's chunks are kept."""
        return math.ceil(self.held_out_chunks * self.fleet_chunks / self.chunks)


def learn(album: Album, config: TrainingConfig, checkpoint: Path, report: Report | None = None) -> KeypointNetwork:
    """Train a network on one thread; a checkpoint after each epoch is taken up again by the same command.

    Every epoch takes another sample of each picture.
    """
    torch.set_num_threads(1)
    torch.manual_seed(config.seed)
    network = KeypointNetwork()
    network.to(memory_format=torch.channels_last)
    steps = len(album) // config.batch
    optimizer = torch.optim.AdamW(network.parameters(), config.learning_rate, weight_decay=config.weight_decay)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, config.learning_rate, round(config.horizon * config.epochs * steps), pct_start=config.warm_up
    )
    total = config.epochs + config.restart_epochs
    for epoch in range(_resume(checkpoint, config, (network, optimizer, schedule)), total):
        rng = np.random.default_rng([config.seed, epoch])
        order = rng.permutation(len(album))[: steps * config.batch].reshape(steps, config.batch)
        network.train()
        for step, rows in enumerate(order):
            loss = _loss(network, varied(rng, samples_of(rng, album, rows)))
            optimizer.zero_grad(set_to_none=True)
            loss.backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
            optimizer.step()
            _set_rate(optimizer, schedule, epoch + (step + 1) / steps, config)
            if report:
                report(f"epoch {epoch + 1} of {total}", step + 1, steps)
        state = [part.state_dict() for part in (network, optimizer, schedule)]
        _save(checkpoint, {"config": asdict(config), "epoch": epoch + 1, "state": state})
    return network


def _set_rate(
    optimizer: torch.optim.Optimizer,
    schedule: torch.optim.lr_scheduler.LRScheduler,
    done: float,
    config: TrainingConfig,
) -> None:
    """The learning rate after `done` epochs."""
    if done <= config.epochs:
        schedule.step()
        rate = optimizer.param_groups[0]["lr"] * min(1.0, (1 - done / config.epochs) / config.cool_down)
    else:
        rate = config.restart_rate * (1 - (done - config.epochs) / config.restart_epochs)
    for group in optimizer.param_groups:
        group["lr"] = rate


def _loss(network: KeypointNetwork, samples: Samples) -> torch.Tensor:
    crops = torch.from_numpy(to_input(samples.cuts)).contiguous(memory_format=torch.channels_last)
    keypoints, visible, angle = (
        torch.from_numpy(part.astype(np.float32)) for part in (samples.keypoints, samples.visible, samples.angles_rad)
    )
    with torch.autocast("cpu", torch.bfloat16):
        answers = network(crops)
    return total_loss(answers, keypoints, visible, angle)


def _save(path: Path, state: dict[str, object]) -> None:
    buffer = io.BytesIO()
    torch.save(state, buffer)
    remove_leftovers_of(path)
    write_atomically(path, buffer.getvalue(), ModelError)


def _resume(path: Path, config: TrainingConfig, parts: tuple[Any, Any, Any]) -> int:
    """Load a checkpoint of the same configuration into network, optimizer and schedule; the epoch to go on with."""
    found: dict[str, Any] = torch.load(path, weights_only=True) if path.exists() else {"config": None}
    if found["config"] != asdict(config):
        return 0
    for part, state in zip(parts, found["state"], strict=True):
        part.load_state_dict(state)
    epoch: int = found["epoch"]
    return epoch


def evaluate(network: KeypointNetwork, samples: Samples, batch: int = 64) -> Score:
    """Figures on samples as they were drawn."""
    network.eval()

    def answers(crops: Singles) -> Answers:
        with torch.no_grad():
            return tuple(answer.numpy() for answer in network(torch.from_numpy(crops)))

    starts = range(0, len(samples), batch)
    found = [answers_of(answers, to_input(samples.cuts[start : start + batch])) for start in starts]
    heat, visible, log_sigma, angle = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return score(heat, visible, log_sigma, angle, samples)


def export(network: KeypointNetwork, path: Path) -> None:
    """Write the network as ONNX with an open batch size."""
    network = network.eval().to(memory_format=torch.contiguous_format)
    buffer = io.BytesIO()
    axes = {name: {0: "n"} for name in ("crops", *OUTPUTS)}
    example = torch.zeros(2, 4, 96, 128)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # the newer exporter needs two more packages
        torch.onnx.export(
            network,
            (example,),
            buffer,
            input_names=["crops"],
            output_names=list(OUTPUTS),
            dynamic_axes=axes,
            opset_version=OPSET,
            dynamo=False,
        )
    remove_leftovers_of(path)
    write_atomically(path, buffer.getvalue(), ModelError)


def held_out(cars: list[Path], fleet: list[Path], config: TrainingConfig) -> tuple[Album, dict[str, Samples]]:
    """Pictures to learn from, and samples of other vehicles and scenes to score on: of cars, and of a fleet."""
    kept = {"cars": cars[: config.held_out_chunks], "fleet": fleet[: config.held_out_fleet_chunks]}
    samples = {}
    for number, (kind, paths) in enumerate(kept.items()):
        if paths:
            album, rng = load_album(paths), np.random.default_rng([config.seed, HELD_OUT - number])
            samples[kind] = samples_of(rng, album, range(len(album)))
    return load_album(cars[config.held_out_chunks :] + fleet[config.held_out_fleet_chunks :]), samples
