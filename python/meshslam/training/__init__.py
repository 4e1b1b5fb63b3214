"""Drawn cars with their labels, and the key point network that learns from them (extra `train`)."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from meshslam.training.pictures import draw_chunks
    from meshslam.training.train import TrainingConfig, evaluate, export, held_out, learn

__all__ = ["TrainingConfig", "draw_chunks", "evaluate", "export", "held_out", "learn"]


def __getattr__(name: str) -> Any:  # noqa: ANN401 # PyTorch is imported when it is needed
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{'pictures' if name == 'draw_chunks' else 'train'}"), name)
