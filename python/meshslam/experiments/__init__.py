"""The paper's experiments, one module each, and the pages that put its numbers beside ours."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.experiments.kitti import MappedDrive, kitti_experiment
    from meshslam.experiments.localization import STREET, localization_experiment
    from meshslam.experiments.page import Experiment, write_experiment
    from meshslam.experiments.views import ViewsConfig, views_experiment
else:
    __getattr__ = deferred(
        __name__,
        {
            "kitti": "MappedDrive kitti_experiment",
            "localization": "STREET localization_experiment",
            "page": "Experiment write_experiment",
            "views": "ViewsConfig views_experiment",
        },
    )

__all__ = [
    "STREET",
    "Experiment",
    "MappedDrive",
    "ViewsConfig",
    "kitti_experiment",
    "localization_experiment",
    "views_experiment",
    "write_experiment",
]
