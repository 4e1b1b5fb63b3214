"""The run's map as a map in tiles, which `localize` reads where the camera is."""

from __future__ import annotations

from pathlib import Path

from meshslam.exporting.finished_run import FinishedRun
from meshslam.exporting.formats import Notes
from meshslam.maps import TILE_M, MapObject, TiledMap

_AT_ONCE = 5000  # objects that are written together


def write(run: FinishedRun, target: Path) -> Notes:
    """Tiles of 100 m; a map that is in tiles already is written anew, in the same tiles."""
    city = TiledMap.create(target, tile_m=TILE_M if run.tiled is None else run.tiled.index.tile_m)
    waiting: list[MapObject] = []
    for objects in (run.scene.objects,) if run.tiled is None else run.tiled.tiles():
        waiting += objects
        if len(waiting) >= _AT_ONCE:
            city.put(waiting)
            waiting = []
    city.put(waiting)
    return ()
