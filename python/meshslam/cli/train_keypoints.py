"""`meshslam train-keypoints`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def train_keypoints(
    out: Annotated[Path, typer.Option(help="Folder for the pictures, the checkpoint and the network.")],
    seed: Annotated[int, typer.Option(help="Decides cars, scenes and weights.")] = 1,
    chunks: Annotated[int, typer.Option(help="How many chunks of pictures are drawn.", min=2)] = 45,
    chunk_size: Annotated[int, typer.Option(help="Pictures of a chunk, of the same 16 cars.", min=32)] = 400,
    held_out: Annotated[int, typer.Option(help="Chunks of them that are kept for the figures.", min=1)] = 5,
    epochs: Annotated[int, typer.Option(help="Passes over the pictures, each in another way.", min=1)] = 9,
    workers: Annotated[int, typer.Option(help="Processes that draw.", min=1)] = 1,
) -> None:
    """Train the network that finds the key points of cars, on drawn cars alone. Needs the extra `train` (PyTorch).

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
    config = TrainingConfig(seed=seed, chunks=chunks, chunk_size=chunk_size, held_out_chunks=held_out, epochs=epochs)
    out.mkdir(parents=True, exist_ok=True)
    with locked(out / LOCK, str(out), ModelError), progress_bars() as bars:
        paths = draw_chunks(out / "pictures", seed, chunks, config.chunk_size, workers, bars)
        learnt, kept = split(paths, config)
        network = learn(learnt, config, out / "checkpoint.pt", bars)
    export(network, out / "car_keypoints.onnx")
    for key, value in asdict(evaluate(network, kept)).items():
        print(f"{key}: {value:.4f}")
    print(f"{out / 'car_keypoints.onnx'}: give it as keypoints.model in the configuration")
