"""Settings of the factor graph."""

from __future__ import annotations

from dataclasses import dataclass

from meshslam.settings import Settings, expert, public


@dataclass(frozen=True)
class StartConfig(Settings):
    """How well the first state is known."""

    position_sigma_m: float = public(0.02, above=0, doc="the first position, from initial_state.yaml")
    rotation_sigma_deg: float = public(0.1, above=0, doc="its roll and pitch")
    heading_sigma_deg: float = public(0.1, above=0, doc="its heading")
    velocity_sigma_m_s: float = public(0.05, above=0, doc="its velocity")


@dataclass(frozen=True)
class SmootherConfig(Settings):
    """The window of the fixed-lag smoother."""

    lag_s: float = public(2.0, above=0, doc="length of the window that is estimated again with every frame")
    iterations: int = expert(2, low=1)  # a frame
    settled_frames: int = expert(5, low=1)  # views so old are held as linear factors
