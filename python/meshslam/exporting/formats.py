"""The formats that a run is exported in, by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from meshslam.exporting.finished_run import FinishedRun
from meshslam.exporting.geojson import GeoOrigin

Notes = tuple[str, ...]  # what a format could not say


@dataclass(frozen=True)
class Format:
    """One format: where it is written by default, what it holds, and what it needs."""

    default_name: str  # of the file, or of the folder
    summary: str
    module: str  # of this room, its function `write`
    is_folder: bool = False
    packages: tuple[str, ...] = ()
    extra: str = ""
    takes_images: bool = False
    needs_origin: bool = False
    takes_origin: bool = False  # where one is given; a package of `geo` is needed then
    of_map: bool = False  # whether a map without a path is enough
    in_tiles: bool = False  # whether a map in tiles is read tile by tile

    def write(self, run: FinishedRun, target: Path, origin: GeoOrigin | None) -> Notes:
        """Write a run to a path that is not there; what could not be said in this format is returned as notes."""
        write: Callable[..., Notes] = import_module(f"meshslam.exporting.{self.module}").write
        return write(run, target, origin) if self.needs_origin or self.takes_origin else write(run, target)


FORMATS: dict[str, Format] = {
    "glb": Format("map.glb", "objects, path and cameras as binary glTF, with their properties", "glb", of_map=True),
    "usd": Format("map.usdc", "the same as a USD stage, z up, in metres", "usd", packages=("pxr",), extra="usd"),
    "ply": Format(
        "map.ply",
        "all meshes in the world as one PLY, with colours, object numbers and sigmas",
        "world_ply",
        of_map=True,
    ),
    "obj": Format("map.obj", "all meshes in the world as one OBJ, an object each", "world_obj", of_map=True),
    "tiles": Format("city", "the map in tiles, for localize in large maps", "tiles", True, of_map=True, in_tiles=True),
    "3dtiles": Format(
        "3dtiles",
        "OGC 3D Tiles 1.1 with binary glTF; on the earth with --origin and the extra geo",
        "tiles_3d",
        True,
        takes_origin=True,
        of_map=True,
        in_tiles=True,
    ),
    "tum": Format("trajectory.tum", "camera poses in the world: time, position, quaternion", "tum"),
    "kitti": Format("poses.txt", "camera poses from the first camera, 3 x 4 a line", "kitti_poses"),
    "kitti-labels": Format("label_2", "boxes of the cars in each frame, as KITTI's label_2", "kitti_labels", True),
    "euroc": Format("data.csv", "camera poses, velocities and biases, as EuRoC's ground truth", "euroc"),
    "csv": Format("tables", "objects.csv and trajectory.csv", "csv_tables", True),
    "parquet": Format(
        "parquet", "the same tables as Parquet", "parquet_tables", True, packages=("pyarrow",), extra="parquet"
    ),
    "rrd": Format(
        "run.rrd", "a recording for the Rerun viewer", "rrd", packages=("rerun",), extra="rerun", takes_images=True
    ),
    "mcap": Format(
        "run.mcap",
        "Foxglove's schemas, for Foxglove and Rerun",
        "mcap",
        packages=("foxglove_schemas_protobuf", "mcap", "mcap_protobuf"),
        extra="foxglove",
        takes_images=True,
    ),
    "ros2bag": Format(
        "ros2bag",
        "odometry, path, meshes and transforms of ROS 2",
        "ros2bag",
        True,
        packages=("rosbags",),
        extra="bags",
    ),
    "colmap": Format("colmap", "cameras, images and the meshes' points as a COLMAP text model", "colmap", True),
    "geojson": Format(
        "map.geojson",
        "footprints and path on the earth; needs --origin",
        "geojson",
        packages=("pymap3d",),
        extra="geo",
        needs_origin=True,
        of_map=True,
    ),
}
