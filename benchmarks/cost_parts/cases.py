"""Recordings that costs are measured on: real ones with images, drawn ones with images, and drawn masks."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("MESHSLAM_DATA", ROOT.parent / "shared" / "data"))
ODOMETRY = DATA / "kitti_odometry"
DRIVE_0048 = DATA / "kitti_raw" / "2011_09_26" / "2011_09_26_drive_0048_sync"
NETWORK = DATA / "models" / "yolov5n-seg.onnx"
MASKS = ((70, 6), (140, 24), (280, 12), (280, 48))  # frames and cars of drawn masks along KITTI 06


@dataclass(frozen=True)
class Case:
    """A command on a part of a recording."""

    name: str
    command: str
    images: Path | None  # their folder
    given: dict[str, Any]  # settings of its input
    map_of: str = ""  # the case whose run is the map

    @property
    def image_bytes(self) -> int:
        """Of the images of its frames."""
        first, end = map(int, self.given.get("frames", "0:1000000").split(":"))
        files = [] if self.images is None else sorted(self.images.glob("*.png"))
        return sum(file.stat().st_size for file in files[first:end])

    def part(self, frames: int, first: int = 0) -> Case:
        """Some of its frames."""
        chosen = {"frames": f"{first}:{first + frames}"}
        return replace(self, name=f"{self.name} {frames}", given={**self.given, **chosen})


def cases(work: Path) -> list[Case]:
    """All of them; recordings are made once."""
    street = drawn_street(work / "street")
    look = {"segmenter": str(NETWORK)}
    truth, grey = str(street / "groundtruth.tum"), ODOMETRY / "06" / "image_0"
    mapped = Case("street map", "map", street / "images", {"sequence": str(street), "poses": truth, **look})
    found = Case("street slam", "slam", street / "images", {"sequence": str(street), **look})
    known = Case("street localize", "localize", street / "images", {"sequence": str(street), **look}, "street map 60")
    inertial = {"imu": str(ODOMETRY / "imu" / "06.csv"), "imu_from_camera": str(ODOMETRY / "camera_from_imu.json")}
    real = Case("06 map", "map", grey, {"sequence": str(ODOMETRY / "06"), **look})
    real_slam = Case("06 slam", "slam", grey, {"sequence": str(ODOMETRY / "06"), **look, **inertial})
    return [
        *(mapped.part(frames) for frames in (20, 40, 60)),
        *(real.part(frames, 51 - frames) for frames in (17, 34, 51)),
        Case("0048 map", "map", DRIVE_0048 / "image_02" / "data", {"sequence": str(DRIVE_0048), **look}),
        *(found.part(frames) for frames in (40, 50, 60)),
        *(real_slam.part(frames, 51 - frames) for frames in (35, 43, 51)),
        *(known.part(frames) for frames in (20, 40, 60)),
        *(case for frames, cars in MASKS for case in masks(work, frames, cars)),
    ]


def masks(work: Path, frames: int, cars: int) -> list[Case]:
    """Drawn masks along KITTI 06, with known poses, and with its IMU instead."""
    name, size = f"masks {frames}/{cars}", ("--start", 0, "--frames", frames, "--cars", cars)
    known = along_06(work / f"known_{frames}_{cars}", *size, "--known-poses")
    hidden = along_06(work / f"hidden_{frames}_{cars}", *size)
    return [
        Case(f"{name} map", "map", None, {"sequence": str(known)}),
        Case(f"{name} slam", "slam", None, {"sequence": str(hidden)}),
        Case(f"{name} localize", "localize", None, {"sequence": str(hidden), "map": str(hidden / "objects.json")}),
    ]


def drawn_street(out: Path) -> Path:
    """60 frames of 800 x 240 with 20 parked cars, in colour, with an IMU."""
    if not (out / "association.json").is_file():
        given = ("--frames", "60", "--cars", "10", "--seed", "5", "--hidden-poses", "--quiet", "--overwrite")
        subprocess.run([sys.executable, "-m", "meshslam", "simulate", str(out), *given], check=True)
    return out


def along_06(out: Path, *arguments: object) -> Path:
    """Real car models beside KITTI 06's path and IMU, by the tool that is none of our code."""
    if not (out / "objects.json").is_file():
        given = ("--poses", ODOMETRY / "poses" / "06.txt", "--times", ODOMETRY / "times_06.txt")
        command = [sys.executable, DATA.parent / "tools" / "make_case.py", "localize", out, *given]
        command += ["--imu", ODOMETRY / "imu" / "06.csv", *arguments]
        subprocess.run([str(word) for word in command], check=True, capture_output=True)
    return out
