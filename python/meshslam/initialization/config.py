"""Settings of estimation: the IMU, how motion starts, the smoother."""

from __future__ import annotations

from dataclasses import dataclass, field

from meshslam.graph import SmootherConfig, StartConfig
from meshslam.initialization.gravity_alignment import AlignmentConfig
from meshslam.motion import ImuConfig
from meshslam.settings import Settings, expert


@dataclass(frozen=True)
class UnknownStartConfig(Settings):
    """How well the first state is known that is found without initial_state.yaml, and how it is found."""

    tilt_sigma_deg: float = expert(3.0, above=0)
    velocity_sigma_m_s: float = expert(0.5, above=0)
    velocity_sigma_share: float = expert(0.12, low=0)  # and so much of the speed
    settling_s: float = expert(3.0, above=0)  # run again and again from the state that they end up with
    max_settling_rounds: int = expert(4, low=1)
    alignment: AlignmentConfig = field(default_factory=AlignmentConfig)


@dataclass(frozen=True)
class EstimationConfig(Settings):
    """What localization and SLAM have in common."""

    imu: ImuConfig = field(default_factory=ImuConfig)
    start: StartConfig = field(default_factory=StartConfig)
    unknown_start: UnknownStartConfig = field(default_factory=UnknownStartConfig)
    smoother: SmootherConfig = field(default_factory=SmootherConfig)
