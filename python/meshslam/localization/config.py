"""Settings of localization in a map."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from meshslam.geometry import NoiseModel


@dataclass(frozen=True)
class AssociationConfig:
    """Which detection shows which mapped object."""

    min_iou: float = 0.25  # of the predicted mask with the detection's
    min_iou_same_id: float = 0.10  # where the detection's track id is the object's id
    id_bonus: float = 0.10  # added to the overlap there
    max_distance_m: float = 70.0


@dataclass(frozen=True)
class GateConfig:
    """Which observations are believed."""

    max_cost: float = 2.5  # of an observation at the pose that all agree on, per independent one
    moved_views: int = 3  # an object whose observations are refused so often in a row was moved


@dataclass(frozen=True)
class ObservationNoiseConfig:
    """Noise of a mask's border and of key points against a map's mesh."""

    border_sigma_px: float = 1.5
    border_correlation_px: float = 25.0  # length of border over which its error is one and the same
    border_kernel: float = 3.0  # Huber's threshold, in sigmas
    border_cap_px: float = 60.0  # residuals are cut here
    outline_step_px: float = 6.0  # spacing of the outline's samples
    keypoint_position_sigma_m: float = 0.02  # of a map's key points
    keypoint_kernel: float = 3.0  # Geman and McClure's threshold, in sigmas

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


@dataclass(frozen=True)
class LocalizationConfig:
    """Settings of `localize`, beside those of estimation."""

    solver: Literal["smoother", "gradient"] = "smoother"  # gradient: the paper's, pose by pose
    association: AssociationConfig = field(default_factory=AssociationConfig)
    gate: GateConfig = field(default_factory=GateConfig)
    noise: ObservationNoiseConfig = field(default_factory=ObservationNoiseConfig)
    edge_margin_px: int = 10  # a border this near to the image's edge is not the object's own
    min_box_px: float = 20.0
    use_map_covariance: bool = True  # objects with a covariance are estimated along, else they are fixed
    gradient_iterations: int = 20  # of the solver `gradient`, a frame
    gradient_keypoint_weight: float = 0.01  # likewise, of a squared residual in sigmas, against a mask's IoU
