"""A city of a million cars: bytes a car, opening, localizing against a hundred cars, finding where a drive begins.

    .venv/bin/python benchmarks/city.py [--cars 1000000] [--work FOLDER] [--rounds 3] [--record]

A case of KITTI 06's path with six cars is mapped. These cars are in both maps at their places; all others are drawn
from the category's shape space, in streets of parked cars around. Needs the data and tools that `$MESHSLAM_DATA`
names (default ../shared/data, its tools beside it).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from localize import COMMAND, ROOT, make, run, score
from results import record

from meshslam.categories import load_category
from meshslam.files import arrays_to_bytes
from meshslam.geometry import Pose
from meshslam.localization import RelocalizationConfig
from meshslam.maps import Map, MapObject, TiledMap, TileEntry, find_constellation
from meshslam.maps.tile import Tile
from meshslam.object_slam import SlamLocalMapping
from meshslam.perception import read_detections, track
from meshslam.sequences import open_sequence

BLOCK_M, ROW_M, ROWS = 100.0, 50.0, 2  # a tile has two streets, each with cars on both sides
PER_TILE = 60
DRAWN_TILES = 50
CAR = load_category("car")
DRIVE_M = 400.0  # cars of other streets keep so far from the case


def drawn_cars(first_id: int, count: int, column: int, row: int, rng: np.random.Generator) -> list[MapObject]:
    """Parked cars of one tile: drawn shapes, with a surface, sigmas and a covariance such as mapping gives."""
    car, cars = CAR, []
    for k in range(count):
        bumps = rng.normal(0, 0.01, car.vertices.shape)
        vertices = car.shape(0.8 * rng.normal(size=len(car.modes))) + (bumps + bumps[car.mirror] * [1, -1, 1]) / 2
        along, street, side = rng.uniform(0, BLOCK_M), k % ROWS, (k // ROWS) % 2
        place = [column * BLOCK_M + along, row * BLOCK_M + (street + 0.5) * ROW_M + (4.0 if side else -4.0), 0.75]
        sigma = rng.uniform(0.02, 0.2, len(vertices))
        spread = 0.05 * rng.normal(size=(6, 6))
        cars.append(
            MapObject(
                first_id + k,
                "car",
                Pose.from_yaw(rng.normal(np.pi * side, 0.05), np.array(place)),
                vertices,
                car.faces,
                views=9,
                first_frame=0,
                last_frame=20,
                mask_iou=0.9,
                keypoints=dict(zip(car.keypoint_names, car.keypoints(vertices), strict=True)),
                pose_covariance=spread @ spread.T,
                vertex_sigma_m=(sigma + sigma[car.mirror]) / 2,
                vertex_observed=rng.random(len(vertices)) < 0.5,
            ).recentred()
        )
    return cars


def tiles_around(count: int, path: np.ndarray) -> Iterator[tuple[int, int]]:
    """Tiles of a square that keep away from a path."""
    side = int(np.ceil(np.sqrt(count))) + 12
    middle = np.floor(path.mean(axis=0) / BLOCK_M).astype(int)
    for column in range(middle[0] - side // 2, middle[0] + side // 2 + 2):
        for row in range(middle[1] - side // 2, middle[1] + side // 2 + 2):
            centre = (np.array([column, row]) + 0.5) * BLOCK_M
            if np.linalg.norm(path - centre, axis=1).min() > DRIVE_M:
                yield column, row


def build(folder: Path, own: Map, path: np.ndarray, cars: int) -> TiledMap:
    """The city with the case's cars in it; built once: some tiles of cars are drawn, and laid again and again."""
    if TiledMap.is_at(folder):
        return TiledMap.open(folder)
    began_s, rng = time.monotonic(), np.random.default_rng(1)
    city = TiledMap.create(folder)
    drawn = [drawn_cars(0, PER_TILE, 0, 0, rng) for _ in range(min(DRAWN_TILES, cars // PER_TILE + 1))]
    city.put([*own.objects, *drawn_cars(999, 1, 10**4, 10**4, rng)])  # one far away, for the category's file
    packed = [(tile, tile.to_bytes()[1]) for tile in (Tile.of(things, {"car": CAR}) for things in drawn)]
    made = len(own)
    for key in tiles_around(cars // PER_TILE + 1, path):
        if made >= cars:
            break
        city.index.entries[key] = laid(*packed[rng.integers(len(packed))], key, 1000 + made, city.folder)
        made += PER_TILE
    (folder / "city.json").write_bytes(city.index.to_bytes())
    print(f"  {made} cars made in {time.monotonic() - began_s:.0f} s", flush=True)
    return TiledMap.open(folder)


def laid(tile: Tile, meshes: bytes, key: tuple[int, int], first_id: int, folder: Path) -> TileEntry:
    """Write a tile's cars into another tile, as others."""
    shift = np.array([BLOCK_M * key[0], BLOCK_M * key[1], 0.0])
    columns = {"id": tile.table["id"] + first_id, "position": tile.table["position"] + shift}
    contents = arrays_to_bytes({**tile.table, **columns}), meshes
    digests = [hashlib.blake2b(content, digest_size=16).hexdigest() for content in contents]
    last_id = first_id + len(tile) - 1
    entry = TileEntry(*key, len(tile), first_id, last_id, sum(map(len, contents)), *digests)
    for name, content in zip((entry.table, entry.meshes), contents, strict=True):
        (folder / "tiles" / name).write_bytes(content)
    return entry


def opened_s(folder: Path) -> float:
    """Seconds from the call to the first answer, in a process of its own, imports aside."""
    code = (
        "import time, sys, numpy; from meshslam.maps import Map, TiledMap; import meshslam.maps.tile\n"
        "began = time.perf_counter(); city = Map.open(sys.argv[1]); count = len(city)\n"
        "print(time.perf_counter() - began)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(folder)], check=True, capture_output=True, text=True)
    return float(done.stdout)


def localized(case: Path, scene: Path, out: Path) -> tuple[float, float, dict[str, float]]:
    """Wall seconds, peak MB, and the independent figures of a run of `localize`."""
    began_s = time.monotonic()
    with subprocess.Popen(
        [*COMMAND, "localize", str(case), "--map", str(scene), "--out", str(out), "--overwrite", "--quiet"],
        stdout=subprocess.DEVNULL,
    ) as process:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if status:
        raise SystemExit(f"localize in {scene} ended with {process.returncode}")
    return time.monotonic() - began_s, usage.ru_maxrss / 1024, score(case, out)["trajectory"]


def relocalized_s(case: Path, city: TiledMap) -> tuple[float, float, int]:
    """Seconds to find the cars of a case's first seconds in a city, metres by which that is off, and frames needed.

    The local map is made by SLAM before. The index is there.
    """
    recording, names = open_sequence(case), {"car": CAR.keypoint_names}
    detections = track(read_detections(case / "detections.json"), None).by_frame()
    mapping = SlamLocalMapping(recording.camera, recording.imu_from_camera, names, str(case))
    config, index = RelocalizationConfig().constellations, city.constellations(40.0)
    start = np.loadtxt(case / "groundtruth.tum")[0, 1:4]
    seconds = []
    for k, frame in enumerate(recording.frame_ids):
        imu = recording.imu if k == 0 else None
        mapping.take(frame, float(recording.times_s[k]), imu, detections.get(frame, ()))
        local = mapping.local_map() if k % 10 == 9 else None
        if local is not None:
            began_s = time.perf_counter()
            found = find_constellation(index, local.objects, config)
            seconds.append(time.perf_counter() - began_s)
            if not found.refused:
                away = found.known_from_seen.transform(np.zeros((1, 3)))[0] - start
                return max(seconds), float(np.linalg.norm(away[:2])), k + 1
    raise SystemExit(f"not found: {found.refused}")


def main() -> None:
    """Build, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cars", type=int, default=1_000_000)
    parser.add_argument("--work", type=Path, default=ROOT / "benchmarks" / "out" / "city")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--record", action="store_true", help="write the figures to docs/results.json")
    a = parser.parse_args()
    a.work.mkdir(parents=True, exist_ok=True)
    common = ("--start", 300, "--frames", 70, "--cars", 6, "--seed", 300)
    case = make(a.work / "case", *common)
    other = make(a.work / "pass", *common, "--lateral", 1.5, "--known-poses", "--noise-seed", 9)
    if not (a.work / "map" / "metrics.json").is_file():
        run("map", other, "--out", a.work / "map")
    own, path = Map.load(a.work / "map"), np.loadtxt(case / "groundtruth.tum")[:, 1:3]
    small = build(a.work / "hundred", own, path, 100)
    large = build(a.work / f"city_{a.cars}", own, path, a.cars)
    size = sum(entry.bytes for entry in large.index.entries.values()) / len(large)
    disk = sum(p.stat().st_blocks * 512 for p in large.folder.rglob("*") if p.is_file()) / len(large)
    index = (large.folder / "city.json").stat().st_size / len(large)
    print(f"{len(large)} cars in {len(large.index.entries)} tiles: {size:.0f} bytes a car, {index:.0f} of the index")
    print(f"  with the file system's blocks {disk:.0f} bytes a car")
    opening = sorted(opened_s(large.folder) for _ in range(5))[2]
    print(f"opening: {opening:.3f} s")
    began_s = time.monotonic()
    shards = sum(1 for _ in large.constellations(40.0).shards())
    index_bytes = sum(p.stat().st_size for p in (large.folder / "constellations").iterdir()) / len(large)
    print(f"index: {shards} shards, {index_bytes:.0f} bytes a car, made or read in {time.monotonic() - began_s:.1f} s")
    search_s, off_m, frames = relocalized_s(case, large)
    print(f"without a start: found in {search_s:.2f} s a search, {off_m:.2f} m off, after {frames} frames")
    lost = a.work / "case_without_start"
    shutil.copytree(case, lost, dirs_exist_ok=True)
    (lost / "initial_state.yaml").unlink(missing_ok=True)
    wall_s, peak_mb, of_lost = localized(lost, large.folder, a.work / "run_lost")
    print(f"  localize: {wall_s:.1f} s, {peak_mb:.0f} MB, ATE {of_lost['ate_rmse_m']:.4f} m")
    rows: dict[str, list[tuple[float, float, dict[str, float]]]] = {"hundred": [], "city": []}
    for k in range(a.rounds):
        for name, scene in (("hundred", small), ("city", large)):
            rows[name].append(localized(case, scene.folder, a.work / f"run_{name}"))
            wall_s, peak_mb, found = rows[name][-1]
            print(
                f"  round {k} {name:8s} {wall_s:6.2f} s {peak_mb:6.1f} MB  ATE {found['ate_rmse_m']:.4f} m", flush=True
            )
    least = {name: (min(r[0] for r in of), min(r[1] for r in of)) for name, of in rows.items()}
    ratios = [least["city"][i] / least["hundred"][i] for i in (0, 1)]
    same = (a.work / "run_city" / "trajectory.tum").read_bytes() == (
        a.work / "run_hundred" / "trajectory.tum"
    ).read_bytes()
    print(f"city against hundred: time {ratios[0]:.2f} x, memory {ratios[1]:.2f} x, the same path: {same}")
    if a.record:
        figures = {
            "cars": len(large),
            "bytes_a_car": size + index,
            "opening_s": opening,
            "localize_time_ratio": ratios[0],
            "localize_memory_ratio": ratios[1],
            "ate_m": rows["city"][-1][2]["ate_rmse_m"],
            "search_s": search_s,
            "ate_without_start_m": of_lost["ate_rmse_m"],
        }
        record("localize in a city", "benchmarks/city.py", figures)
        print(json.dumps(figures))


if __name__ == "__main__":
    main()
