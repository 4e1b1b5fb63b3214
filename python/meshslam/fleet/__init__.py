"""Many drives: each step of each drive is a job for a process of this machine or for Ray."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.fleet.drives import Drive, Fleet, Needs
    from meshslam.fleet.engine import Engine
    from meshslam.fleet.jobs import Running
    from meshslam.fleet.places import Folder, Place, Url
    from meshslam.fleet.reading import read_fleet
    from meshslam.fleet.results import DriveResult
    from meshslam.fleet.running import engine_of, place_of, run_fleet
    from meshslam.fleet.scheduling import RETRIES, Watch
    from meshslam.fleet.summary import PAGE, can_write_parquet
else:
    __getattr__ = deferred(
        __name__,
        {
            "drives": "Drive Fleet Needs",
            "engine": "Engine",
            "jobs": "Running",
            "places": "Folder Place Url",
            "reading": "read_fleet",
            "results": "DriveResult",
            "running": "engine_of place_of run_fleet",
            "scheduling": "RETRIES Watch",
            "summary": "PAGE can_write_parquet",
        },
    )

__all__ = [
    "PAGE",
    "RETRIES",
    "Drive",
    "DriveResult",
    "Engine",
    "Fleet",
    "Folder",
    "Needs",
    "Place",
    "Running",
    "Url",
    "Watch",
    "can_write_parquet",
    "engine_of",
    "place_of",
    "read_fleet",
    "run_fleet",
]
