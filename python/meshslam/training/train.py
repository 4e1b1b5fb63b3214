"""Training of the key point network: draw, learn, export."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from meshslam.maps import write_atomically
from meshslam.perception.keypoints.crop import to_input
from meshslam.training.augment import varied
from meshslam.training.dataset import Samples, load_samples
from meshslam.training.losses import total_loss
from meshslam.training.network import KeypointNetwork
from meshslam.training.score import Score, score

Report = Callable[[str, int, int], None]
OUTPUTS = ("heat", "visible", "log_sigma", "angle")
OPSET = 17


@dataclass(frozen=True)
class TrainingConfig:
    """What decides the weights."""

    seed: int = 1
    chunks: int = 78  # of 200 samples
    held_out_chunks: int = 5
    cycles: tuple[int, ...] = (4,)  # epochs of each rise and fall of the learning rate
    batch: int = 32
    learning_rate: float = 3e-3  # at its first peak
    weight_decay: float = 1e-3
    warm_up: float = 0.1  # share of the steps


def learn(samples: Samples, config: TrainingConfig, checkpoint: Path, report: Report | None = None) -> KeypointNetwork:
    """Train a network on one thread; a checkpoint after each epoch is taken up again by the same command."""
    torch.set_num_threads(1)
    torch.manual_seed(config.seed)
    network = KeypointNetwork()
    network.to(memory_format=torch.channels_last)
    for number, epochs in enumerate(config.cycles):
        _cycle(network, samples, config, (number, epochs), checkpoint, report)
    return network


def _cycle(
    network: KeypointNetwork,
    samples: Samples,
    config: TrainingConfig,
    cycle: tuple[int, int],
    checkpoint: Path,
    report: Report | None,
) -> None:
    """One rise and fall of the learning rate, half as high as the one before."""
    number, epochs = cycle
    steps, rate = len(samples) // config.batch, config.learning_rate / 2**number
    optimizer = torch.optim.AdamW(network.parameters(), rate, weight_decay=config.weight_decay)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, rate, epochs * steps, pct_start=config.warm_up)
    for epoch in range(_resume(checkpoint, config, cycle, (network, optimizer, schedule)), epochs):
        rng = np.random.default_rng([config.seed, sum(config.cycles[:number]) + epoch])
        order = rng.permutation(len(samples))[: steps * config.batch].reshape(steps, config.batch)
        network.train()
        for step, rows in enumerate(order):
            loss = _loss(network, varied(rng, samples.chosen(rows)))
            optimizer.zero_grad(set_to_none=True)
            loss.backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
            optimizer.step()
            schedule.step()
            if report:
                report(f"cycle {number + 1}, epoch {epoch + 1}", step + 1, steps)
        state = [part.state_dict() for part in (network, optimizer, schedule)]
        _save(checkpoint, {"config": asdict(config), "cycle": number, "epoch": epoch + 1, "state": state})


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
    write_atomically(path, buffer.getvalue())


def _resume(path: Path, config: TrainingConfig, cycle: tuple[int, int], parts: tuple[Any, Any, Any]) -> int:
    """Load a checkpoint of the same configuration into network, optimizer and schedule; the epoch to go on with."""
    number, epochs = cycle
    found: dict[str, Any] = torch.load(path, weights_only=True) if path.exists() else {"config": None}
    if found["config"] != asdict(config) or found["cycle"] < number:
        return 0
    if found["cycle"] > number:
        return epochs
    for part, state in zip(parts, found["state"], strict=True):
        part.load_state_dict(state)
    epoch: int = found["epoch"]
    return epoch


def _as_saved(config: TrainingConfig) -> dict[str, Any]:
    return asdict(config)


def evaluate(network: KeypointNetwork, samples: Samples, batch: int = 64) -> Score:
    """Figures on samples as they were drawn."""
    network.eval()
    found = []
    with torch.no_grad():
        for start in range(0, len(samples), batch):
            crops = torch.from_numpy(to_input(samples.cuts[start : start + batch]))
            found.append([answer.numpy() for answer in network(crops)])
    heat, visible, log_sigma, angle = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return score(heat, visible, log_sigma, angle, samples)


def export(network: KeypointNetwork, path: Path) -> None:
    """Write the network as ONNX with an open batch size."""
    network = network.eval().to(memory_format=torch.contiguous_format)
    buffer = io.BytesIO()
    axes = {name: {0: "n"} for name in ("crops", *OUTPUTS)}
    example = torch.zeros(2, 4, 96, 128)
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
    write_atomically(path, buffer.getvalue())


def held_out(paths: list[Path], config: TrainingConfig) -> tuple[Samples, Samples]:
    """Samples to learn from, and those of other cars and scenes to score on."""
    return load_samples(paths[config.held_out_chunks :]), load_samples(paths[: config.held_out_chunks])
