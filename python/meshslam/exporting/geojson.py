"""Footprints and path on the earth, as GeoJSON (RFC 7946: WGS 84, longitude before latitude)."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from meshslam.errors import ConfigError
from meshslam.exporting.finished_run import FinishedRun, positions_of
from meshslam.exporting.tables import object_table
from meshslam.geometry import Floats

if TYPE_CHECKING:
    from meshslam.exporting.formats import Notes

DEGREE_DECIMALS = 9  # 0.1 mm


@dataclass(frozen=True)
class GeoOrigin:
    """Where the world's origin is on WGS 84, and where its x axis points."""

    latitude_deg: float
    longitude_deg: float
    height_m: float = 0.0  # above the ellipsoid
    heading_deg: float = 90.0  # of the world's x axis, clockwise from north

    @staticmethod
    def parse(given: str) -> GeoOrigin:
        """LAT,LON[,HEIGHT[,HEADING]], degrees and metres; ConfigError for anything else."""
        try:
            values = [float(part) for part in given.split(",")]
        except ValueError:
            values = []
        if not 2 <= len(values) <= 4 or not np.isfinite(values).all() or abs(values[0]) > 90 or abs(values[1]) > 180:
            raise ConfigError(
                f"--origin {given}: expected LATITUDE,LONGITUDE[,HEIGHT[,HEADING]] in degrees and metres, such as "
                "49.011,8.416,0,90: HEADING is that of the world's x axis, clockwise from north"
            )
        return GeoOrigin(*values)

    def longitude_latitude(self, points_in_world: Floats) -> Floats:
        """Degrees (n, 2), longitude first, of points (n, 3) of the world, z up, metres."""
        import pymap3d

        turn = np.radians(self.heading_deg)
        points = np.asarray(points_in_world, float).reshape(-1, 3)
        east = points[:, 0] * np.sin(turn) - points[:, 1] * np.cos(turn)
        north = points[:, 0] * np.cos(turn) + points[:, 1] * np.sin(turn)
        up = points[:, 2]
        latitude, longitude, _ = pymap3d.enu2geodetic(
            east, north, up, self.latitude_deg, self.longitude_deg, self.height_m
        )
        found: Floats = np.round(np.stack([longitude, latitude], axis=-1), DEGREE_DECIMALS)
        return found

    @property
    def earth_from_world(self) -> Floats:
        """The world's axes at the origin, earth-centred (EPSG:4978), metres: a matrix (4, 4)."""
        import pymap3d

        turn = np.radians(self.heading_deg)
        ahead = np.array([np.sin(turn), np.cos(turn), 0.0])  # the world's x axis: east, north, up
        axes = np.stack([ahead, np.array([-ahead[1], ahead[0], 0.0]), np.array([0.0, 0.0, 1.0])])
        place = (self.latitude_deg, self.longitude_deg, self.height_m)
        middle = np.array(pymap3d.geodetic2ecef(*place))
        matrix = np.eye(4)
        for column, axis in enumerate(axes):
            matrix[:3, column] = pymap3d.enu2uvw(*axis, *place[:2])
        matrix[:3, 3] = middle
        return matrix


def write(run: FinishedRun, target: Path, origin: GeoOrigin) -> Notes:
    """A polygon for each object, with its row of the table as properties, and the path as a line."""
    table, features = object_table(run), list[dict[str, Any]]()
    for row, thing in enumerate(run.scene.objects):
        length, width, _ = thing.dimensions / 2
        corners = np.array([[length, width, 0], [-length, width, 0], [-length, -width, 0], [length, -width, 0]])
        ring = origin.longitude_latitude(thing.world_from_object.transform(corners)).tolist()
        properties = {name: values[row] for name, values in table.items()}
        features.append(_feature({"type": "Polygon", "coordinates": [[*ring, ring[0]]]}, properties))
    path = positions_of(run)
    if len(path) > 1:
        line = origin.longitude_latitude(path).tolist()
        features.append(_feature({"type": "LineString", "coordinates": line}, {"category": "path", "name": run.name}))
    document = {"type": "FeatureCollection", "features": features}
    target.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return ()


def _feature(geometry: dict[str, Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": geometry}
