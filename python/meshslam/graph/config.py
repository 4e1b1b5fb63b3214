"""Settings of the factor graph."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class StartConfig:
    """How well the first state is known."""

    position_sigma_m: float = 0.02
    rotation_sigma_deg: float = 0.1  # roll and pitch
    heading_sigma_deg: float = 0.1
    velocity_sigma_m_s: float = 0.1


@dataclass(frozen=True)
class SmootherConfig:
    """The window of the fixed-lag smoother."""

    lag_s: float = 2.0
    iterations: int = 2  # a frame
    settled_frames: int = 5  # views so old are held as linear factors
