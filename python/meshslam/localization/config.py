"""Settings of localization in a map."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from meshslam.geometry import NoiseModel
from meshslam.maps import ConstellationConfig
from meshslam.settings import Settings, expert, public


@dataclass(frozen=True)
class AssociationConfig(Settings):
    """Which detection shows which mapped object."""

    min_iou: float = expert(0.25, low=0, high=1)  # of the predicted mask with the detection's
    min_iou_same_id: float = expert(0.10, low=0, high=1)  # where the detection's track id is the object's id
    id_bonus: float = expert(0.10, low=0, high=1)  # added to the overlap there
    max_distance_m: float = public(70.0, above=0, doc="objects of the map further away are not looked for")


@dataclass(frozen=True)
class GateConfig(Settings):
    """Which observations are believed."""

    max_cost: float = expert(2.5, above=0)  # of an observation at the pose that all agree on, per independent one
    moved_views: int = expert(3, low=1)  # an object whose observations are refused so often in a row was moved


@dataclass(frozen=True)
class ObservationNoiseConfig(Settings):
    """Noise of a mask's border and of key points against a map's mesh."""

    border_sigma_px: float = expert(1.5, above=0)
    border_correlation_px: float = expert(25.0, above=0)  # length of border over which its error is one and the same
    border_kernel: float = expert(3.0, above=0)  # Huber's threshold, in sigmas
    border_cap_px: float = expert(60.0, above=0)  # residuals are cut here
    outline_step_px: float = expert(6.0, above=0)  # spacing of the outline's samples
    keypoint_position_sigma_m: float = expert(0.02, low=0)  # of a map's key points
    keypoint_kernel: float = expert(3.0, above=0)  # Geman and McClure's threshold, in sigmas

    def model(self) -> NoiseModel:
        """As the observation model takes it."""
        return NoiseModel(
            border_sigma_px=self.border_sigma_px,
            border_correlation_px=self.border_correlation_px,
            border_kernel=self.border_kernel,
            border_cap_px=self.border_cap_px,
            outline_step_px=self.outline_step_px,
            keypoint_position_sigma_m=self.keypoint_position_sigma_m,
            keypoint_kernel=self.keypoint_kernel,
        )


# A map of a few seconds has a scale that is known to some percent, and most of the cars about it are yet to be seen
OF_FEW_SECONDS = ConstellationConfig(
    scale_sigma=0.04, unshared_cost=0.0, candidates=16, min_evidence=3.0, min_agreement=3.5, max_ambiguity=0.4
)


@dataclass(frozen=True)
class RelocalizationConfig(Settings):
    """How a start that is not given is looked for in a large map."""

    search_every_s: float = expert(1.0, above=0)  # of new frames
    give_up_s: float = expert(30.0, above=0)  # of frames
    constellations: ConstellationConfig = field(default_factory=lambda: OF_FEW_SECONDS)


@dataclass(frozen=True)
class LocalizationConfig(Settings):
    """Settings of `localize`, beside those of estimation."""

    solver: Literal["smoother", "gradient"] = public("smoother", doc="gradient: the paper's, pose by pose")
    association: AssociationConfig = field(default_factory=AssociationConfig)
    gate: GateConfig = field(default_factory=GateConfig)
    noise: ObservationNoiseConfig = field(default_factory=ObservationNoiseConfig)
    relocalization: RelocalizationConfig = field(default_factory=RelocalizationConfig)
    edge_margin_px: int = expert(10, low=0)  # a border this near to the image's edge is not the object's own
    min_box_px: float = expert(20.0, low=0)
    use_map_covariance: bool = public(True, doc="objects with a covariance are estimated along, else they are fixed")
    gradient_iterations: int = expert(20, low=0)  # of the solver `gradient`, a frame
    gradient_keypoint_weight: float = expert(0.01, low=0)  # likewise, of a squared residual in sigmas
