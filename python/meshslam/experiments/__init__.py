"""The paper's experiments, one module each, and the pages that put its numbers beside ours."""

from meshslam.experiments.kitti import MappedDrive, kitti_experiment
from meshslam.experiments.localization import STREET, localization_experiment
from meshslam.experiments.page import Experiment, write_experiment
from meshslam.experiments.views import ViewsConfig, views_experiment

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
