"""Real drives: KITTI raw 0048 and the first 51 frames of odometry 06, mapped and localized in, scored independently.

    .venv/bin/python benchmarks/drives.py [--record]

Needs the data and tools that `$MESHSLAM_DATA` names (default ../shared/data, its tools beside it).
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from localize import DATA, ROOT, TOOLS, run
from results import record

from meshslam.maps import Trajectory
from meshslam.sequences import open_sequence

DRIVE = DATA / "kitti_raw" / "2011_09_26" / "2011_09_26_drive_0048_sync"
SEGMENTER = ("--segmenter", DATA / "models" / "yolov5n-seg.onnx")


def scored(*arguments: object) -> dict[str, Any]:
    """What the scorer that is none of our code says."""
    command = [sys.executable, TOOLS / "score_run.py", *arguments]
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=True)
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def map_0048(work: Path) -> dict[str, float]:
    """Cars, mask IoU, share of wide detections mapped."""
    figures = run("map", DRIVE, *SEGMENTER, "--out", work / "run48")
    found = scored("--masks", work / "run48")
    return {"objects": figures["objects_mapped"], **{key: found[key] for key in ("mask_iou_mean", "share_mapped")}}


def map_06(work: Path) -> dict[str, float]:
    """Distance of lidar points to the meshes of the two cars that are passed closely."""
    sequence = DATA / "kitti_odometry" / "06"
    run("map", sequence, *SEGMENTER, "--out", work / "run06")
    cars = scored("--lidar", sequence / "lidar_cars.npz", work / "run06")["objects"]
    return {f"{car}_{key}_m": cars[car][f"{key}_m"] for car in ("car_35", "car_38") for key in ("median", "p90")}


def other_camera(work: Path) -> dict[str, float]:
    """Path of 0048's right camera, in the map of its left one, against OXTS."""
    out = work / "right48"
    run("localize", DRIVE, "--camera", "3", *SEGMENTER, "--map", work / "run48", "--out", out)
    found = Trajectory.load(out / "trajectory.tum")
    recording = open_sequence(DRIVE, camera_number=3)
    at = {
        round(float(time_s), 6): pose
        for time_s, pose in zip(recording.times_s, recording.world_from_camera or (), strict=True)
    }
    away = [
        pose.translation - at[round(float(time_s), 6)].translation
        for time_s, pose in zip(found.times_s, found.world_from_camera, strict=True)
    ]
    return {"poses": len(away), "ate_m": float(np.sqrt((np.array(away) ** 2).sum(axis=1).mean()))}


def main() -> None:
    """Run all, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, default=ROOT / "benchmarks" / "out" / "drives")
    parser.add_argument("--record", action="store_true", help="write the figures to docs/results.json")
    a = parser.parse_args()
    a.work.mkdir(parents=True, exist_ok=True)
    for name, measure in (("map 0048", map_0048), ("map 06", map_06), ("localize 0048, right camera", other_camera)):
        figures = measure(a.work)
        print(name, figures, flush=True)
        if a.record:
            record(name, "benchmarks/drives.py", figures)


if __name__ == "__main__":
    main()
