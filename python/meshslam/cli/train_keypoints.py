"""`meshslam train-keypoints`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def train_keypoints(
    out: Annotated[Path, typer.Option(help="Folder for the pictures, the checkpoint and the network.")],
    seed: Annotated[int, typer.Option(help="Decides cars, scenes and weights.")] = 1,
    chunks: Annotated[int, typer.Option(help="How many chunks of pictures of cars are drawn.", min=2)] = 35,
    fleet_chunks: Annotated[int, typer.Option(help="And of vans, trucks, buses and cars together.", min=0)] = 14,
    chunk_size: Annotated[int, typer.Option(help="Pictures of a chunk, of the same 16 vehicles.", min=32)] = 400,
    held_out: Annotated[
        int, typer.Option(help="Chunks of cars that are kept for the figures; of the fleet in proportion.", min=1)
    ] = 5,
    epochs: Annotated[int, typer.Option(help="Passes over the pictures, each in another way.", min=1)] = 9,
    restart_epochs: Annotated[int, typer.Option(help="More passes, at a learning rate that starts anew.", min=0)] = 4,
    workers: Annotated[int, typer.Option(help="Processes that draw.", min=1)] = 1,
) -> None:
    """Train the network that finds the key points of vehicles, on drawn ones alone. Needs the extra `train` (PyTorch).

    The same command goes on where it was cut short. The defaults give the network that is shipped.

    Example: meshslam train-keypoints --out training
    """
    from dataclasses import asdict

    from meshslam.cli.progress import progress_bars
    from meshslam.errors import ModelError
    from meshslam.files import LOCK, locked

    try:
        import torch  # noqa: F401 # the extra is there
    except ImportError:
        raise ModelError("training needs PyTorch, which is not installed: pip install 'meshslam[train]'") from None
    from meshslam.training import TrainingConfig, draw_chunks, evaluate, export, learn
    from meshslam.training import held_out as split

    if held_out >= chunks:
        raise ModelError(f"--held-out {held_out}: of {chunks} chunks none is left to learn from")
    config = TrainingConfig(
        seed=seed,
        chunks=chunks,
        fleet_chunks=fleet_chunks,
        chunk_size=chunk_size,
        held_out_chunks=held_out,
        epochs=epochs,
        restart_epochs=restart_epochs,
    )
    if fleet_chunks and config.held_out_fleet_chunks >= fleet_chunks:
        raise ModelError(f"--held-out {held_out}: of {fleet_chunks} chunks of the fleet none is left to learn from")
    out.mkdir(parents=True, exist_ok=True)
    with locked(out / LOCK, str(out), ModelError), progress_bars() as bars:
        cars = draw_chunks(out / "pictures", seed, chunks, chunk_size, workers, bars)
        fleet = draw_chunks(out / "pictures", seed, fleet_chunks, chunk_size, workers, bars, "fleet")
        learnt, kept = split(cars, fleet, config)
        network = learn(learnt, config, out / "checkpoint.pt", bars)
    export(network, out / "car_keypoints.onnx")
    for kind, samples in kept.items():
        for key, value in asdict(evaluate(network, samples)).items():
            print(f"{kind}: {key}: {value:.4f}")
    print(f"{out / 'car_keypoints.onnx'}: give it as keypoints.model in the configuration")
