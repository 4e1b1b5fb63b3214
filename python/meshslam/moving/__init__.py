"""Objects that drive: one shape, and a path with poses, velocity and uncertainty."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.moving.config import MovingConfig
    from meshslam.moving.estimate import Begun, Estimated, PathBounds, begin_moving, finish_moving
    from meshslam.moving.shape_prior import ShapeEvidence, ShapePrior
else:
    __getattr__ = deferred(
        __name__,
        {
            "config": "MovingConfig",
            "estimate": "Begun Estimated PathBounds begin_moving finish_moving",
            "shape_prior": "ShapeEvidence ShapePrior",
        },
    )

__all__ = [
    "Begun",
    "Estimated",
    "MovingConfig",
    "PathBounds",
    "ShapeEvidence",
    "ShapePrior",
    "begin_moving",
    "finish_moving",
]
