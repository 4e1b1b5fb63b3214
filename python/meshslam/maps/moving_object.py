"""One object of a map that drives."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from meshslam.geometry import Floats, Ints, Pose
from meshslam.maps.moving_path import MovingPath
from meshslam.maps.objects import MapObject

MOVING = "moving"  # the folder of paths and meshes, and the key in map.json


@dataclass(frozen=True, eq=False)
class MovingObject:
    """A vehicle with its path and its own mesh.

    `body` is the object as it was at `body_time_s`, where it was seen best: its frame, mesh and key points are those
    of a `MapObject`. `path` says where it was at all times.

    Example:
        scene = meshslam.Map.load("run")
        for car in scene.moving:
            car.path.times_s, car.path.speeds_m_s  # (n,) seconds, (n,) m/s
            car.vertices_at(car.path.times_s[0])  # (V, 3) in the world

    """

    body: MapObject
    body_time_s: float
    path: MovingPath

    @property
    def id(self) -> int:
        """Its number, which no other object of the map has."""
        return self.body.id

    @property
    def category(self) -> str:
        """Its class."""
        return self.body.category

    @property
    def vertices(self) -> Floats:
        """The mesh's vertices (V, 3), in object, metres."""
        return self.body.vertices

    @property
    def faces(self) -> Ints:
        """The mesh's faces (F, 3)."""
        return self.body.faces

    def pose_at(self, time_s: float) -> Pose:
        """world_from_object; MapError outside the path's times."""
        return self.path.at(time_s)

    def vertices_at(self, time_s: float) -> Floats:
        """The mesh's vertices (V, 3) in the world, metres; MapError outside the path's times."""
        return self.path.at(time_s).transform(self.vertices)

    def recentred(self) -> MovingObject:
        """The same object with the origin of its frame at the centre of its bounding box, at all times."""
        body = self.body.recentred()
        if body is self.body:
            return self
        origin = (self.vertices.max(axis=0) + self.vertices.min(axis=0)) / 2
        return replace(self, body=body, path=self.path.of_origin(origin))

    @property
    def files(self) -> tuple[str, str, str]:
        """Names of the mesh, of the path (CSV) and of its poses (TUM), in the map's folder."""
        stem = f"{MOVING}/{self.id}"
        return f"{stem}.ply", f"{stem}.csv", f"{stem}.tum"

    def entry(self) -> dict[str, Any]:
        """What map.json says beside the body's own entry."""
        speeds, path = np.abs(self.path.speeds_m_s), self.path
        _, table, poses = self.files
        steps = np.linalg.norm(np.diff(path.positions_in_world, axis=0), axis=1)
        return {
            "moving": True,
            "timestamp": _rounded(self.body_time_s, 9),
            "path": table,
            "trajectory": poses,
            "times": [_rounded(float(path.times_s[0]), 9), _rounded(float(path.times_s[-1]), 9)],
            "path_length_m": _rounded(float(steps.sum()), 3),
            "speed_m_s": {"mean": _rounded(float(speeds.mean()), 3), "max": _rounded(float(speeds.max()), 3)},
            "speed_sigma_m_s": _rounded(float(np.median(path.speed_sigmas_m_s)), 3),
            "position_sigma_m": _rounded(float(np.median(path.position_sigmas_m)), 3),
        }


def _rounded(value: float, decimals: int) -> float:
    return float(np.round(value, decimals) + 0.0)
