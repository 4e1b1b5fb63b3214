"""What a map in tiles costs: a drive's cars put into cities of several sizes, opening, looking around."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from city import build, drawn_cars

from meshslam.maps import Map, TiledMap

CARS = (10_000, 100_000, 1_000_000)
PUT = 91  # cars of a drive: those of all of KITTI 06


def measured_tiles(folder: Path, mapped: Path, sizes: tuple[int, ...] = CARS) -> list[dict[str, Any]]:
    """A row a size; `mapped` is a run whose cars are in each city."""
    own = Map.load(mapped)
    path = np.loadtxt(mapped / "trajectory.tum")[:, 1:3]
    return [_row(build(folder / f"city_{cars}", own, path, cars).folder) for cars in sizes]


def _row(city: Path) -> dict[str, Any]:
    opened = min(_took_s(lambda: TiledMap.open(city)) for _ in range(5))
    held = TiledMap.open(city)
    rng, keys = np.random.default_rng(3), sorted(held.index.entries)
    chosen = [keys[k] for k in rng.integers(len(keys), size=200)]
    cold = [_took_s(lambda key=key: held.near((np.array(key) + 0.5) * 100.0, 30.0)) for key in chosen]
    warm = min(_took_s(lambda: held.near((np.array(chosen[-1]) + 0.5) * 100.0, 30.0)) for _ in range(5))
    puts = [_put_s(city, (keys[k][0], keys[k][1]), 10**8 + 1000 * k, rng) for k in (5, len(keys) // 2, -5 % len(keys))]
    entries = held.index.entries.values()
    return {
        "cars": len(held),
        "tiles": len(keys),
        "bytes_a_car": sum(entry.bytes for entry in entries) / len(held),
        "index_bytes": (city / "city.json").stat().st_size,
        "open_s": opened,
        "near_cold_s": float(np.median(cold)),
        "near_warm_s": warm,
        "put_cars": PUT,
        "put_s": float(np.median(puts)),
    }


def _put_s(city: Path, key: tuple[int, int], first_id: int, rng: np.random.Generator) -> float:
    """A drive's cars, along a row of tiles; they are taken out again."""
    cars = [
        replace(car, id=first_id + 10 * j + k)
        for j in range(12)
        for k, car in enumerate(drawn_cars(0, 8 if j < 11 else 3, key[0] + j, key[1], rng))
    ]
    held = TiledMap.open(city)
    seconds = _took_s(lambda: held.put(cars))
    held.remove([car.id for car in cars])
    return seconds


def _took_s(work: Callable[[], object]) -> float:
    began_s = time.process_time()
    work()
    return time.process_time() - began_s
