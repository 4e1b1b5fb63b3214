"""Drives in one world: laid on each other by the cars that they share, each of which becomes one."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.merging.config import MergingConfig, VisitConfig
    from meshslam.merging.documents import drives_json, visits_json
    from meshslam.merging.drives import Drive, DriveViews, drive_names, in_order, read_drives
    from meshslam.merging.merge import merge_drives
    from meshslam.merging.moves import MergedCar
    from meshslam.merging.result import LaidDrive, Merged, World
    from meshslam.merging.visits import Visit
else:
    __getattr__ = deferred(
        __name__,
        {
            "config": "MergingConfig VisitConfig",
            "documents": "drives_json visits_json",
            "drives": "Drive DriveViews drive_names in_order read_drives",
            "merge": "merge_drives",
            "moves": "MergedCar",
            "result": "LaidDrive Merged World",
            "visits": "Visit",
        },
    )

__all__ = [
    "Drive",
    "DriveViews",
    "LaidDrive",
    "Merged",
    "MergedCar",
    "MergingConfig",
    "Visit",
    "VisitConfig",
    "World",
    "drive_names",
    "drives_json",
    "in_order",
    "merge_drives",
    "read_drives",
    "visits_json",
]
