"""What merging costs: pairs of drives that are compared, and cars that are fitted to the views of all drives."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from meshslam.merging import MergingConfig, merge_drives, read_drives
from meshslam.merging.links import link_drives

from .cases import along_06

PASSES, STREETS = 6, (300,)
CARS = 14


def measured_merging(folder: Path) -> dict[str, Any]:
    """Rows of passes of one street, and the comparison of drives of different streets."""
    same = [_mapped(folder, 100, k) for k in range(PASSES)]
    apart = [same[0], *(_mapped(folder, start, 0) for start in STREETS)]
    rows = [_row(same[:count]) for count in (2, 4, PASSES)]
    return {"passes": rows, "apart": _row(apart)}


def _row(runs: list[Path]) -> dict[str, float]:
    drives, _ = read_drives(runs)
    began_s = time.process_time()
    link_drives(drives, MergingConfig())
    linked_s = time.process_time() - began_s
    began_s = time.process_time()
    merged = merge_drives(drives)
    total_s = time.process_time() - began_s
    cars = [car for world in merged.worlds for car in world.cars]
    visits = sum(visit.number is not None for car in cars for visit in car.visits)
    pairs = len(runs) * (len(runs) - 1) // 2
    return {
        "drives": len(runs),
        "pairs": pairs,
        "cars": len(cars),
        "visits": visits,
        "compare_s": linked_s,
        "total_s": total_s,
    }


def _mapped(folder: Path, start: int, number: int) -> Path:
    """A pass of a street, with other noise and the camera moved aside, mapped."""
    name = f"pass_{start}_{number}"
    aside = ("--lateral", round(0.4 * (number % 5), 1)) if number % 5 else ()
    size = ("--start", start, "--frames", 70, "--cars", CARS, "--seed", start, "--noise-seed", 50 + number)
    case, out = along_06(folder / "cases" / name, *size, "--known-poses", *aside), folder / "runs" / name
    if not (out / "metrics.json").is_file():
        command = [sys.executable, "-m", "meshslam", "map", str(case), "--out", str(out), "--quiet", "--overwrite"]
        subprocess.run(command, check=True)
    return out
