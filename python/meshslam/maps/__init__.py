"""The map of objects and the camera's path: files that are whole or not there, and exports for viewers."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred
from meshslam.files import remove_leftovers, write_atomically, write_together

if TYPE_CHECKING:
    from meshslam.maps.camera_path import CameraPath
    from meshslam.maps.constellation import Constellation, ConstellationConfig
    from meshslam.maps.constellation_index import ConstellationIndex
    from meshslam.maps.constellation_search import find_constellation
    from meshslam.maps.constellations import ConstellationMatch, match_constellations, match_near
    from meshslam.maps.figures import read_figures
    from meshslam.maps.gltf import linear, object_colour, save_glb, to_glb, vertex_colours
    from meshslam.maps.map import Map
    from meshslam.maps.moving_object import MovingObject
    from meshslam.maps.moving_path import MovingPath
    from meshslam.maps.objects import MapObject
    from meshslam.maps.ply import PlyMesh, format_ply
    from meshslam.maps.run_directory import FRAMES, INDEX, RunDirectory
    from meshslam.maps.tile_index import TileEntry, TileIndex
    from meshslam.maps.tiled_map import TILE_M, TiledMap
    from meshslam.maps.trajectory import Trajectory
    from meshslam.maps.trajectory_estimate import TrajectoryEstimate
else:
    __getattr__ = deferred(
        __name__,
        {
            "camera_path": "CameraPath",
            "constellation": "Constellation ConstellationConfig",
            "constellation_index": "ConstellationIndex",
            "constellation_search": "find_constellation",
            "constellations": "ConstellationMatch match_constellations match_near",
            "figures": "read_figures",
            "gltf": "linear object_colour save_glb to_glb vertex_colours",
            "map": "Map",
            "moving_object": "MovingObject",
            "moving_path": "MovingPath",
            "objects": "MapObject",
            "ply": "PlyMesh format_ply",
            "run_directory": "FRAMES INDEX RunDirectory",
            "tile_index": "TileEntry TileIndex",
            "tiled_map": "TILE_M TiledMap",
            "trajectory": "Trajectory",
            "trajectory_estimate": "TrajectoryEstimate",
        },
    )

__all__ = [
    "FRAMES",
    "INDEX",
    "TILE_M",
    "CameraPath",
    "Constellation",
    "ConstellationConfig",
    "ConstellationIndex",
    "ConstellationMatch",
    "Map",
    "MapObject",
    "MovingObject",
    "MovingPath",
    "PlyMesh",
    "RunDirectory",
    "TileEntry",
    "TileIndex",
    "TiledMap",
    "Trajectory",
    "TrajectoryEstimate",
    "find_constellation",
    "format_ply",
    "linear",
    "match_constellations",
    "match_near",
    "object_colour",
    "read_figures",
    "remove_leftovers",
    "save_glb",
    "to_glb",
    "vertex_colours",
    "write_atomically",
    "write_together",
]
