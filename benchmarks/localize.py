"""Localization and SLAM on KITTI 06's real IMU and path among real car models: cases, runs, independent scores.

    .venv/bin/python benchmarks/localize.py [--quick] [--only NAME] [--work FOLDER] [--record]

Needs the data and tools that `$MESHSLAM_DATA` names (default ../shared/data, its tools beside it).
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import yaml
from results import record
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).resolve().parent.parent
DATA = Path(os.environ.get("MESHSLAM_DATA", ROOT.parent / "shared" / "data"))
TOOLS = DATA.parent / "tools"
COMMAND = (sys.executable, "-m", "meshslam")
STARTS = (100, 300, 500, 700)


def make(case: Path, *arguments: object) -> Path:
    """A case by the tool that is none of our code; made once."""
    if not (case / "objects.json").is_file():
        odometry = DATA / "kitti_odometry"
        given = ("--poses", odometry / "poses" / "06.txt", "--times", odometry / "times_06.txt")
        command = [sys.executable, TOOLS / "make_case.py", "localize", case, *given]
        command += ["--imu", odometry / "imu" / "06.csv", *arguments]
        subprocess.run([str(word) for word in command], check=True, capture_output=True)
    return case


def turned(case: Path, target: Path, degrees: float) -> Path:
    """The same case with imu_from_camera turned about a skew axis."""
    shutil.copytree(case, target, dirs_exist_ok=True)
    camera = yaml.safe_load((target / "camera.yaml").read_text())
    mounted = np.array(camera["imu_from_camera"])
    axis = np.array([1.0, 1.0, 1.0]) / np.sqrt(3)
    mounted[:3, :3] = mounted[:3, :3] @ Rotation.from_rotvec(np.radians(degrees) * axis).as_matrix()
    camera["imu_from_camera"] = mounted.tolist()
    (target / "camera.yaml").write_text(yaml.safe_dump(camera, default_flow_style=None))
    return target


def unaware(case: Path, target: Path) -> Path:
    """The same case without initial_state.yaml."""
    shutil.copytree(case, target, dirs_exist_ok=True)
    (target / "initial_state.yaml").unlink(missing_ok=True)
    return target


def reckoned(case: Path, target: Path, seed: int = 1) -> Path:
    """The same case with poses.tum: the true steps with 3% of their length and 0.1 degrees of noise, and no IMU."""
    unaware(case, target)
    (target / "imu.csv").unlink(missing_ok=True)
    rows, rng = np.loadtxt(target / "groundtruth.tum"), np.random.default_rng(seed)
    true = [np.eye(4) for _ in rows]
    for pose, row in zip(true, rows, strict=True):
        pose[:3, 3], pose[:3, :3] = row[1:4], Rotation.from_quat(row[4:]).as_matrix()
    poses = true[:1]
    for one, other in pairwise(true):
        step = np.linalg.inv(one) @ other
        step[:3, 3] *= 1 + rng.normal(0, 0.03)
        step[:3, :3] = step[:3, :3] @ Rotation.from_rotvec(np.radians(rng.normal(0, 0.1, 3))).as_matrix()
        poses.append(poses[-1] @ step)
    (target / "poses.tum").write_text(tum(rows[:, 0], poses))
    return target


def tum(times_s: np.ndarray, poses: list[np.ndarray]) -> str:
    """Poses as a TUM file."""
    rows = [[t, *p[:3, 3], *Rotation.from_matrix(p[:3, :3]).as_quat()] for t, p in zip(times_s, poses, strict=True)]
    return "".join(" ".join(f"{x:.9f}" for x in row) + "\n" for row in rows)


def truth_of_06(folder: Path) -> Path:
    """The true path of KITTI 06's 51 frames, in its world."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = np.loadtxt(DATA / "kitti_odometry" / "poses" / "06.txt")[:51].reshape(-1, 3, 4)
    axes = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
    poses = [axes @ np.vstack([row, [0, 0, 0, 1]]) for row in rows]
    (folder / "groundtruth.tum").write_text(tum(np.loadtxt(DATA / "kitti_odometry" / "times_06.txt")[:51], poses))
    return folder


def real_slam(work: Path) -> Iterator[tuple[str, Path, Path, dict[str, float]]]:
    """Name, truth, run, figures of `slam` on the real pictures of KITTI 06, whose poses it does not use."""
    odometry, truth = DATA / "kitti_odometry", truth_of_06(work / "truth06")
    mounted = ("--imu-from-camera", odometry / "camera_from_imu.json")
    segmenter = ("--segmenter", DATA / "models" / "yolov5n-seg.onnx")
    for name, flags in (
        ("real 06, IMU", ("--imu", odometry / "imu" / "06.csv", *mounted)),
        ("real 06, images alone", ()),
        ("real 06, odometry", ("--poses", "odometry")),
    ):
        out = work / "runs" / name.replace(" ", "_").replace(",", "")
        yield name, truth, out, run("slam", odometry / "06", *segmenter, *flags, "--out", out)


def other_slam_jobs(work: Path, quick: bool) -> Iterator[tuple[str, Path, tuple[str, ...]]]:
    """Name, case, flags of runs of `slam` that start unaware, go by odometry, or use the paper's solver."""
    for start in STARTS[:1] if quick else STARTS:
        clean = work / f"clean{start}"
        yield f"slam, no start {start}", unaware(clean, work / f"unaware{start}"), ()
        yield f"slam, odometry {start}", reckoned(clean, work / f"reckoned{start}"), ("--poses", "odometry")
        yield f"slam, gradient {start}", clean, ("--solver", "gradient")


def run(*arguments: object) -> dict[str, float]:
    """A command's figures."""
    command = [*COMMAND, *map(str, arguments), "--overwrite", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)}: {done.stderr}")
    figures: dict[str, float] = json.loads(done.stdout)
    return figures


def score(case: Path, out: Path, *flags: str) -> dict[str, dict[str, float]]:
    """Figures by the scorer that is none of our code."""
    command = [sys.executable, TOOLS / "score_run.py", case, out, *flags]
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=True)
    found: dict[str, dict[str, float]] = json.loads(done.stdout)
    return found


def localization_jobs(work: Path, quick: bool) -> Iterator[tuple[str, Path, Path, tuple[str, ...]]]:
    """Name, case, map, flags of each run of `localize`."""
    for start in STARTS[:1] if quick else STARTS:
        common = ("--start", start, "--frames", 70, "--cars", 6, "--seed", start)
        clean = make(work / f"clean{start}", *common)
        yield f"clean {start}", clean, clean / "objects.json", ()
        yield f"gradient {start}", clean, clean / "objects.json", ("--solver", "gradient")
        blind = unaware(clean, work / f"unaware{start}")
        yield f"no start {start}", blind, blind / "objects.json", ()
        skew = turned(clean, work / f"turned{start}", 1.4)
        yield f"turned 1.4 deg {start}", skew, skew / "objects.json", ()
        wrong = make(work / f"wrong{start}", *common, "--wrong-ids", 0.1)
        yield f"wrong ids {start}", wrong, wrong / "objects.json", ()
        moved = make(work / f"moved{start}", *common, "--shift-map", 0.3)
        yield f"moved cars {start}", moved, moved / "map_shifted.json", ()
        other = make(work / f"pass{start}", *common, "--lateral", 1.5, "--known-poses", "--noise-seed", 9)
        mapped = work / f"map{start}"
        if not (mapped / "metrics.json").is_file():
            run("map", other, "--out", mapped)
        yield f"mapped in another pass {start}", clean, mapped, ()
    if not quick:
        long = make(work / "long", "--start", 0, "--frames", 1000, "--cars", 100, "--no-ids")
        yield "1000 frames, no ids", long, long / "objects.json", ()


def slam_cases(*, quick: bool) -> Iterator[tuple[str, tuple[object, ...]]]:
    """Name and arguments of each case of `slam`: other starts, other cars, all of 06 with its loop."""
    for start in STARTS[:1] if quick else sorted({*STARTS, *range(0, 900, 100)}):
        for seed in (start,) if quick else (start, start + 7):
            yield f"slam {start} {seed}", ("--start", start, "--frames", 70, "--cars", 6, "--seed", seed)
    if not quick:
        everything = ("--start", 0, "--frames", 1100, "--cars", 120)
        yield "slam, whole drive", everything
        yield "slam, whole drive, no ids", (*everything, "--no-ids")


def main() -> None:
    """Run all, print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, default=ROOT / "benchmarks" / "out" / "localize")
    parser.add_argument("--quick", action="store_true", help="one start only")
    parser.add_argument("--only", default="", help="cases whose name holds this")
    parser.add_argument("--record", action="store_true", help="write the figures to docs/results.json")
    a = parser.parse_args()
    a.work.mkdir(parents=True, exist_ok=True)
    table = Table(a.record)
    titles = {"case": 32, "ATE m": 7, "aligned %": 9, "rot deg": 7, "end %": 6, "IMU m": 7, "frames/s": 8}
    print(" ".join(f"{title:{'<' if title == 'case' else '>'}{width}s}" for title, width in titles.items()) + "  poses")
    for name, case, scene, flags in localization_jobs(a.work, a.quick):
        if a.only in name:
            out = a.work / "runs" / name.replace(" ", "_")
            figures = run("localize", case, "--map", scene, "--out", out, *flags)
            table.show(name, score(case, out)["trajectory"], figures)
    for name, arguments in slam_cases(quick=a.quick):
        if a.only in name:
            case, out = make(a.work / name.replace(" ", "_"), *arguments), a.work / "runs" / name.replace(" ", "_")
            figures = run("slam", case, "--out", out)
            scores = score(case, out, "--align")
            cars = scores["objects"]
            table.show(name, scores["trajectory"], figures, cars)
            print(
                f"{'':32s} voxel IoU of all, aligned: {cars['voxel_iou_mean_all']:.3f}; cars {cars['matched']:.0f} of "
                f"{cars['true']:.0f}, twice {cars['duplicates']:.0f}, known again {figures['loop_closures']:.0f}"
            )
    for name, case, flags in other_slam_jobs(a.work, a.quick):
        if a.only in name:
            out = a.work / "runs" / name.replace(" ", "_").replace(",", "")
            figures = run("slam", case, "--out", out, *flags)
            table.show(name, score(case, out)["trajectory"], figures)
    if not a.only or a.only.startswith("real"):
        for name, truth, out, figures in real_slam(a.work):
            table.show(name, score(truth, out)["trajectory"], figures)


class Table:
    """Rows as they come; with `keep`, also in docs/results.json, the starts of one kind together."""

    def __init__(self, keep: bool) -> None:
        self.keep = keep
        self.kinds: dict[str, dict[str, list[float]]] = {}

    def show(
        self, name: str, path: dict[str, float], figures: dict[str, float], cars: dict[str, float] | None = None
    ) -> None:
        """One row."""
        rate = figures["frames"] / figures["seconds_localization"]
        aligned = 100 * path["ate_aligned_rmse_m"] / path["path_m"]
        print(
            f"{name:32s} {path['ate_rmse_m']:7.3f} {aligned:9.2f} {path['rotation_rmse_deg']:7.3f} "
            f"{path['end_error_percent']:6.2f} {figures.get('ate_initial_rmse_m', np.nan):7.3f} {rate:8.1f}  "
            f"{path['poses']} of {path['of']}",
            flush=True,
        )
        row = {
            "ate_m": path["ate_rmse_m"],
            "ate_aligned_percent": aligned,
            "rotation_deg": path["rotation_rmse_deg"],
            "end_error_percent": path["end_error_percent"],
            "path_m": path["path_m"],
            "ate_imu_alone_m": figures.get("ate_initial_rmse_m"),
            "voxel_iou_aligned": cars and cars["voxel_iou_mean_all"],
            "cars": cars and cars["true"],
            "cars_found": cars and cars["matched"],
            "cars_twice": cars and cars["duplicates"],
        }
        self._keep(name, {key: value for key, value in row.items() if value is not None})

    def _keep(self, name: str, row: dict[str, float]) -> None:
        if not self.keep:
            return
        kind = name.rstrip("0123456789 ") or name
        rows = self.kinds.setdefault(kind, {key: [] for key in row})
        for key, value in row.items():
            rows.setdefault(key, []).append(value)
        record(kind if kind.startswith(("slam", "real")) else f"localize {kind}", "benchmarks/localize.py", rows)


if __name__ == "__main__":
    main()
