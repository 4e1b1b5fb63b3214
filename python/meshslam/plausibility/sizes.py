"""Whether the objects of a map have the sizes of what they are called: another unit, or another axis up."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from meshslam.geometry import Floats
from meshslam.plausibility.finding import Finding

SIZES_M = (0.05, 60.0)  # longest side of anything that is mapped
VEHICLE_LENGTHS_M = {"car": (2.0, 8.0), "truck": (3.0, 25.0), "bus": (4.0, 25.0)}
_UNITS = (("centimetres", 100.0), ("millimetres", 1000.0), ("inches", 1 / 0.0254), ("feet", 1 / 0.3048))
_UPRIGHT = 1.3  # by which height or width of a vehicle exceeds its length where the axes are others


def judge_sizes(dimensions: Mapping[str, tuple[str, Floats]], source: str) -> list[Finding]:
    """`dimensions` are category and length, width, height (3,) in metres by what an object is called in messages."""
    units = [(name, category, size) for name, (category, size) in dimensions.items() if not _fits(category, size)]
    if units:
        name, category, size = units[0]
        message = (
            f"{source}: {len(units)} of {len(dimensions)} objects have no size in metres (first: {name}, a {category} "
            f"of {' x '.join(f'{side:.4g}' for side in size)} m){_likely(category, size)}"
        )
        return [Finding("map_unit", message, figures={"longest_m": float(size.max()), "objects": float(len(units))})]
    tilted = [(name, size) for name, (category, size) in dimensions.items() if _stands(category, size)]
    if not tilted:
        return []
    name, size = tilted[0]
    message = (
        f"{source}: {len(tilted)} of {len(dimensions)} vehicles are higher or wider than they are long (first: {name}, "
        f"{' x '.join(f'{side:.2f}' for side in size)} m): meshes are x forward, y left, z up; turn them"
    )
    return [Finding("map_up_axis", message, figures={"objects": float(len(tilted))})]


def _fits(category: str, size: Floats) -> bool:
    low, high = VEHICLE_LENGTHS_M.get(category, SIZES_M)
    return low <= float(size.max()) <= high


def _stands(category: str, size: Floats) -> bool:
    return category in VEHICLE_LENGTHS_M and bool(max(size[1], size[2]) > _UPRIGHT * size[0])


def _likely(category: str, size: Floats) -> str:
    fits = [unit for unit, per_m in _UNITS if _fits(category, np.asarray(size) / per_m)]
    return f": they look like {fits[0]}: scale meshes and positions to metres" if fits else ": scale them to metres"
