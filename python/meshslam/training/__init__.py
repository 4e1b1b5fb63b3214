"""Drawn cars with their labels, and the key point network that learns from them (extra `train`)."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.training.pictures import draw_chunks
    from meshslam.training.train import TrainingConfig, evaluate, export, held_out, learn
else:
    __getattr__ = deferred(
        __name__,
        {
            "pictures": "draw_chunks",
            "train": "TrainingConfig evaluate export held_out learn",
        },
    )

__all__ = ["TrainingConfig", "draw_chunks", "evaluate", "export", "held_out", "learn"]
