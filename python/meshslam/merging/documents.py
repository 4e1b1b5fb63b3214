"""The files `visits.json` and `drives.json` of a merged world."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from meshslam.geometry import AnyArray
from meshslam.maps import MapObject
from meshslam.merging.moves import MergedCar
from meshslam.merging.result import LaidDrive, Merged, World
from meshslam.merging.visits import Visit

_DECIMALS = 6
_VARIANCE_DIGITS = 9


def visits_json(merged: Merged, world: World) -> str:
    """What each drive says of each car."""
    cars = [_car(merged, car) for car in world.cars]
    return _text({"format": "meshslam-visits", "version": 1, "drives": _names(merged, world), "cars": cars})


def drives_json(merged: Merged, world: World) -> str:
    """Where each drive lies, how it was laid there, and how well that is known."""
    drives = [_drive(merged, world, laid) for laid in world.drives]
    factor = _numbers(world.variance_factor)
    return _text({"format": "meshslam-drives", "version": 1, "variance_factor": factor, "drives": drives})


def _names(merged: Merged, world: World) -> list[str]:
    return [merged.drives[laid.index].name for laid in world.drives]


def _car(merged: Merged, car: MergedCar) -> dict[str, Any]:
    return {
        "id": car.thing.id,
        "status": car.status,
        "visits": [_visit(merged, visit) for visit in car.visits],
        **({"earlier": [_place(thing) for thing in car.earlier]} if car.earlier else {}),
    }


def _visit(merged: Merged, visit: Visit) -> dict[str, Any]:
    """What is not known is left out."""
    drive = merged.drives[visit.drive]
    thing = None if visit.number is None else drive.map[visit.number]
    entry = {
        "drive": drive.name,
        "status": visit.status,
        "id": visit.number,
        "frames": visit.frames or None,
        "apart_m": None if visit.apart_m is None else _numbers(visit.apart_m),
        "first_frame": None if thing is None else thing.first_frame,
        "last_frame": None if thing is None else thing.last_frame,
    }
    return {key: value for key, value in entry.items() if value is not None}


def _place(thing: MapObject) -> dict[str, Any]:
    return {
        "world_from_object": _numbers(thing.world_from_object.matrix),
        "dimensions": _numbers(thing.dimensions),
    }


def _drive(merged: Merged, world: World, laid: LaidDrive) -> dict[str, Any]:
    drive = merged.drives[laid.index]
    sigmas = laid.sigmas_at(world.middle_of(merged, laid))
    return {
        "name": drive.name,
        "how": laid.how,
        "world_from_drive": _numbers(laid.world_from_drive.matrix),
        "covariance": np.array([[float(f"{v:.{_VARIANCE_DIGITS}e}") for v in row] for row in laid.covariance]).tolist(),
        "position_sigma_m": _numbers(sigmas[0]),
        "rotation_sigma_deg": _numbers(sigmas[1]),
        "cars": len(drive.map),
        "shared_cars": laid.shared_cars,
        "residual_median_m": _numbers(float(np.median(laid.residuals_m))) if len(laid.residuals_m) else None,
        "residual_max_m": _numbers(float(laid.residuals_m.max())) if len(laid.residuals_m) else None,
        "mean_squared_residual": _numbers(laid.mean_error),
    }


def _numbers(values: AnyArray | float) -> Any:  # noqa: ANN401 # a number, or nested lists of them
    """Rounded, never -0."""
    return (np.round(np.asarray(values, float), _DECIMALS) + 0.0).tolist()


def _text(document: dict[str, Any]) -> str:
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
