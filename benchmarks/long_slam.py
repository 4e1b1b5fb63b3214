"""`slam` over a drive as long as you like, from an IMU and detections: its resident memory and time as it goes on.

    .venv/bin/python benchmarks/long_slam.py [--frames 3000] [--every 500] [--work FOLDER]

The camera weaves along a straight street at 10 m/s, past real car models that stand 20 m apart; the IMU's readings
follow from that path, with noise. The street is drawn once and driven through again and again, each time with new
cars. Needs the data and tools that `$MESHSLAM_DATA` names (default ../shared/data, its tools beside it).
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from localize import DATA, ROOT, TOOLS, tum

from meshslam.runs import Config, InputConfig, Outlet, run_slam

sys.path.insert(0, str(TOOLS))
import make_case  # the tool that is none of our code

PERIOD, INTERVAL_S, SPEED_M_S = 200, 0.1, 10.0  # frames of the street
LENGTH_M = PERIOD * INTERVAL_S * SPEED_M_S
WEAVE_M, ASIDE_M, APART_M, HEIGHT_M = 1.5, 4.5, 20.0, 1.65
IMU_HZ, GYRO_NOISE, FORCE_NOISE = 100, 1e-3, 0.03
WAVE = 2 * np.pi / LENGTH_M
IMU_FROM_CAMERA = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def yaw_rad(time_s: np.ndarray) -> np.ndarray:
    """The camera's heading along y = WEAVE_M sin(WAVE x)."""
    return np.arctan(WEAVE_M * WAVE * np.cos(WAVE * SPEED_M_S * time_s))


def poses(times_s: np.ndarray) -> list[np.ndarray]:
    """world_from_camera, (4, 4)."""
    found = []
    for t, yaw in zip(times_s, yaw_rad(times_s), strict=True):
        pose = make_case.yaw_pose(yaw, [SPEED_M_S * t, WEAVE_M * np.sin(WAVE * SPEED_M_S * t), HEIGHT_M])
        found.append(pose @ IMU_FROM_CAMERA)
    return found


def imu_csv(times_s: np.ndarray, rng: np.random.Generator) -> str:
    """Rates and specific forces in the IMU's axes, x forward, z up."""
    x, yaw = SPEED_M_S * times_s, yaw_rad(times_s)
    turning = np.gradient(yaw, times_s)
    sideways = -WEAVE_M * (WAVE * SPEED_M_S) ** 2 * np.sin(WAVE * x)
    zero = np.zeros(len(x))
    rates = np.column_stack([zero, zero, turning])
    forces = np.column_stack([np.sin(yaw) * sideways, np.cos(yaw) * sideways, zero + 9.81])
    rates, forces = rates + rng.normal(0, GYRO_NOISE, rates.shape), forces + rng.normal(0, FORCE_NOISE, forces.shape)
    rows = np.column_stack([times_s, rates, forces])
    return "timestamp,wx,wy,wz,ax,ay,az\n" + "".join(",".join(f"{v:.9f}" for v in row) + "\n" for row in rows)


def parked(rng: np.random.Generator) -> list[dict[str, Any]]:
    """Cars along three periods of the street, those of each period the same ones: id modulo the count of one."""
    cars, one = make_case.load_cars(DATA / "cars"), int(LENGTH_M / APART_M)
    names = [sorted(cars)[i] for i in rng.integers(len(cars), size=one)]
    things = []
    for k in range(3 * one):
        name, side = names[k % one], 1 if k % 2 else -1
        low = np.ptp(cars[name][0][:, 2]) / 2
        place = [APART_M * (k + 0.5), side * ASIDE_M, low]
        things.append(make_case.make_object(k, name, cars[name], make_case.yaw_pose(np.pi * (side < 0), place)))
    return things


def annotations(frames: int) -> list[dict[str, Any]]:
    """One street drawn, then the same again with the cars' numbers going on."""
    rng, one = np.random.default_rng(1), int(LENGTH_M / APART_M)
    cars, path = parked(rng), poses(INTERVAL_S * np.arange(PERIOD))
    drawn = [make_case.observe(make_case.K_KITTI, pose, cars, k, rng, False) for k, pose in enumerate(path)]
    found: list[dict[str, Any]] = []
    for frame in range(frames):
        for row in drawn[frame % PERIOD]:
            track = row["track_id"] + one * (frame // PERIOD) + 1
            found.append({**row, "id": len(found) + 1, "image_id": frame, "track_id": track})
    return found


def make(folder: Path, frames: int) -> Path:
    """The sequence folder; made once."""
    if (folder / "detections.json").is_file():
        return folder
    folder.mkdir(parents=True, exist_ok=True)
    times_s = INTERVAL_S * np.arange(frames)
    path = poses(times_s)
    camera = {
        "model": "pinhole",
        "resolution": [make_case.WIDTH, make_case.HEIGHT],
        "intrinsics": make_case.K_KITTI.tolist(),
        "height_above_ground_m": HEIGHT_M,
        "imu_from_camera": IMU_FROM_CAMERA.tolist(),
    }
    (folder / "camera.yaml").write_text(yaml.safe_dump(camera, default_flow_style=None))
    (folder / "times.txt").write_text("".join(f"{t:.9f}\n" for t in times_s))
    (folder / "groundtruth.tum").write_text(tum(times_s, path))
    ready = np.arange(round(times_s[-1] * IMU_HZ) + 1) / IMU_HZ
    (folder / "imu.csv").write_text(imu_csv(ready, np.random.default_rng(2)))
    velocity = SPEED_M_S * np.array([1.0, WEAVE_M * WAVE, 0.0])
    start = {"timestamp": 0.0, "world_from_camera": path[0].tolist(), "velocity_in_world": velocity.tolist()}
    (folder / "initial_state.yaml").write_text(yaml.safe_dump(start, default_flow_style=None))
    size = {"width": make_case.WIDTH, "height": make_case.HEIGHT}
    images = [{"id": i, "file_name": f"{i:06d}.png", **size} for i in range(frames)]
    categories = [{"id": 1, "name": "car", "keypoints": make_case.NAMES}]
    document = {"images": images, "categories": categories, "annotations": annotations(frames)}
    (folder / "detections.json").write_text(json.dumps(document))
    return folder


def rss_mb() -> float:
    """Resident memory of this process, MB."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def main() -> None:
    """Make the drive, run SLAM, print what it takes as it goes on."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=3000)
    parser.add_argument("--every", type=int, default=500)
    parser.add_argument("--work", type=Path, default=ROOT / "benchmarks" / "out" / "long_slam")
    a = parser.parse_args()
    drive = make(a.work / f"drive-{a.frames}", a.frames)
    last = {"step": "", "cpu": time.process_time()}

    def progress(step: str, done: int, _total: int) -> None:
        if step != last["step"] or (step == "slam" and done % a.every == 0):
            spent, last["cpu"], last["step"] = time.process_time() - last["cpu"], time.process_time(), step
            print(f"{step:<12} {done:>6}: {rss_mb():6.0f} MB, {spent:7.1f} s of CPU since the last line", flush=True)

    settings = Config(input=InputConfig(sequence=str(drive)))
    os.environ["MESHSLAM_RECORDING"] = "0"
    figures = run_slam(settings, a.work / f"run-{a.frames}", Outlet(progress=progress), overwrite=True)
    names = ("objects_mapped", "end_error_share", "ate_rmse_m", "seconds_total", "peak_memory_mb")
    print({name: figures[name] for name in names if name in figures})


if __name__ == "__main__":
    main()
