"""Disturbed streams for some minutes, also a part of `make fuzz`: `python scripts/fuzz_streams.py [SECONDS] [SEED]`.

Each seed is a drive through a small street, sent to a Slam and to a Localizer. Mixed in are calls that cannot be used,
faults inside of a call, and samples out of order. Whatever is raised must be a MeshslamError, and the poses must be
those of an undisturbed run to 5 cm. Prints each problem with its seed, and ends with 1 if there was any.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from meshslam.localization import Localizer
from meshslam.object_slam import Slam, SlamConfig
from meshslam.runs import Config
from tests.faults.disturbances import disturbed_run
from tests.fixtures import imu_street


def makers() -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """How each run is made, and the frames of a street."""
    street = imu_street.street.__wrapped__()  # type: ignore[attr-defined] # what pytest wraps
    seen, scene = imu_street.seen.__wrapped__(street), imu_street.scene.__wrapped__(street)  # type: ignore[attr-defined]
    folder = SimpleNamespace(mktemp=Path)
    drive = imu_street.drive.__wrapped__(street, folder)  # type: ignore[attr-defined]
    names = {c.name: c.keypoints for c in seen.categories}
    told = {"imu_from_camera": drive.imu_from_camera, "start": drive.initial_state}
    config = Config(slam=SlamConfig(min_baseline_m=2.0, lag_s=0.8))
    more = {"keypoint_names": names["car"], "height_above_ground_m": 1.65, "config": config}
    return {
        "Slam": lambda: Slam(drive.camera, **told | more),
        "Localizer": lambda: Localizer(drive.camera, scene, keypoint_names=names, **told),
    }, list(imu_street.stream(drive, seen))


def main(seconds: float, seed: int) -> int:
    """Run until the time is over; the number of problems."""
    made, items = makers()
    right = {}
    for name, make in made.items():
        run = make()
        right[name] = [run.process(**item).world_from_camera.translation for item in items]
    ends, calls, problems = time.monotonic() + seconds, 0, 0
    while time.monotonic() < ends:
        for name, make in made.items():
            for what, problem in disturbed_run(make(), items, right[name], np.random.default_rng(seed)):
                calls += 1
                if problem:
                    problems += 1
                    print(f"{name}, seed {seed}: {what}: {problem}", flush=True)
        seed += 1
    print(f"{calls} calls, seeds up to {seed - 1}: {problems} problems")
    return problems


if __name__ == "__main__":
    given = [float(word) for word in sys.argv[1:]] + [600.0, 0.0][len(sys.argv) - 1 :]
    sys.exit(1 if main(given[0], int(given[1])) else 0)
