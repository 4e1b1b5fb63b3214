"""Object-level SLAM with instance-specific meshes.

Example:
    import meshslam

    result = meshslam.map_drive("2011_09_26_drive_0048_sync", segmenter="yolov5n-seg.onnx")
    car = result.map[3]
    print(car.vertices.shape, car.world_from_object.translation)

"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from meshslam.live import LiveSlam
    from meshslam.localization import Localizer
    from meshslam.maps import Map, TiledMap, Trajectory, TrajectoryEstimate
    from meshslam.object_slam import Slam
    from meshslam.runs import Config, evaluate, localize, map_drive, merge, slam
    from meshslam.sequences import open_sequence

    __version__: str

__all__ = [
    "Config",
    "LiveSlam",
    "Localizer",
    "Map",
    "Slam",
    "TiledMap",
    "Trajectory",
    "TrajectoryEstimate",
    "__version__",
    "evaluate",
    "localize",
    "map_drive",
    "merge",
    "open_sequence",
    "slam",
]

_ROOM_OF = {
    "Config": "runs",
    "LiveSlam": "live",
    "Localizer": "localization",
    "Map": "maps",
    "Slam": "object_slam",
    "TiledMap": "maps",
    "Trajectory": "maps",
    "TrajectoryEstimate": "maps",
    "evaluate": "runs",
    "localize": "runs",
    "map_drive": "runs",
    "merge": "runs",
    "open_sequence": "sequences",
    "slam": "runs",
}


def __getattr__(name: str) -> Any:  # noqa: ANN401 # rooms are imported when they are first asked for (PEP 562)
    if name == "__version__":
        from importlib.metadata import version

        return version("meshslam")
    if name not in _ROOM_OF:
        raise AttributeError(f"module 'meshslam' has no attribute {name!r}")
    found = getattr(import_module(f"meshslam.{_ROOM_OF[name]}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted(__all__)
