"""How long SLAM's paths are against the true ones, how well they end, and how honest the covariances of its cars are.

    .venv/bin/python benchmarks/slam_scale.py [--starts 100,300] [--seeds 1] [--only NAME] [--work FOLDER] [--record]

70 frames of KITTI 06 and 07, their real IMU and path, among real car models (`make_case.py`, none of our code), with
and without a given start, and drawn streets (`meshslam simulate`). The start of these is exact. In the cases "drawn"
IMU, start, mounting and clock are drawn from the sigmas that the estimator is told, as in `trajectory_uncertainty.py`.
Scored by `score_run.py`, none of our code either.

Columns: the estimated path's length over the true one, less 1; the end error; the ATE after an SE(3); the IMU's end
error; voxel IoU of all cars, aligned; shares of the cars' centres within the stated 68% and 95% regions, in the world
of the given start (aligned where there is none). Needs the data and tools that `$MESHSLAM_DATA` names (default
../shared/data, its tools beside it).
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
from localize import DATA, ROOT, STARTS, TOOLS, score, tum, unaware
from results import record
from trajectory_uncertainty import DRAWN, drawn

import meshslam
from meshslam.errors import SequenceError

SEEDS_APART = 1000
STREETS, STREET_FRAMES = (11, 12, 13, 14), 60
TITLES = ("length %", "end %", "aligned %", "IMU end %", "IoU", "68%", "95%", "cars")


@dataclass(frozen=True)
class Job:
    """A case to run; `kind` is what the rows of a mean have in common."""

    kind: str
    name: str
    case: Path
    settings: meshslam.Config = field(default_factory=meshslam.Config)
    is_started: bool = True


def kitti(work: Path, drive: str, start: int, seed: int) -> Path:
    """A case along a drive of KITTI odometry; made once."""
    case = work / f"{drive}-{start}-{seed}"
    if not (case / "objects.json").is_file():
        odometry = DATA / "kitti_odometry"
        given = ["--poses", odometry / "poses" / f"{drive}.txt", "--times", odometry / f"times_{drive}.txt"]
        given += ["--imu", odometry / "imu" / f"{drive}.csv", "--start", start, "--frames", 70, "--cars", 6]
        given += ["--seed", start, "--noise-seed", start + SEEDS_APART * seed]
        command = [sys.executable, TOOLS / "make_case.py", "localize", case, *given]
        subprocess.run([str(word) for word in command], check=True, capture_output=True)
    return case


def street(work: Path, seed: int) -> Path:
    """A drawn street; made once."""
    case = work / f"street-{seed}"
    if not (case / "objects.json").is_file():
        command = [sys.executable, "-m", "meshslam", "simulate", case, "--seed", seed]
        command += ["--frames", STREET_FRAMES, "--mode", "textureless", "--overwrite"]
        subprocess.run([str(word) for word in command], check=True, capture_output=True)
    return case


def jobs(work: Path, starts: Sequence[int], seeds: int) -> Iterator[Job]:
    """All cases."""
    for seed, drive, start in product(range(seeds), ("06", "07"), starts):
        name, case = f"{drive} from {start}, seed {seed}", kitti(work, drive, start, seed)
        yield Job(drive, name, case)
        blind = unaware(case, work / f"unaware-{drive}-{start}-{seed}")
        yield Job(f"{drive}, no start", f"{name}, no start", blind, is_started=False)
        inexact = drawn(case, work / f"drawn-{drive}-{start}-{seed}", start + seed, "slam")
        yield Job("drawn", f"{name}, drawn", inexact, DRAWN)
    for seed in STREETS:
        yield Job("street", f"street {seed}", street(work, seed))


def length_m(positions: np.ndarray) -> float:
    """Of a path (n, 3)."""
    return float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())


def run(job: Job, runs: Path) -> tuple[Job, list[float] | str]:
    """Run a job, score it; why it was refused, if it was: a drawn IMU may contradict its start."""
    try:
        result = meshslam.slam(job.case, config=job.settings)
    except SequenceError as error:
        return job, str(error)
    out = runs / job.name.replace(" ", "_").replace(",", "")
    result.map.save(out)
    poses = [pose.matrix for pose in result.trajectory.world_from_camera]
    (out / "trajectory.tum").write_text(tum(result.trajectory.times_s, poses))
    truth = np.loadtxt(job.case / "groundtruth.tum")[:, 1:4]
    aligned = score(job.case, out, "--align")
    objects = (score(job.case, out) if job.is_started else aligned)["objects"]
    path = aligned["trajectory"]
    alone = np.array([pose.translation for pose in result.alone])
    imu_end = 100 * float(np.linalg.norm(alone[-1] - truth[-1])) / path["path_m"] if len(alone) else np.nan
    ratio = length_m(result.trajectory.positions_in_world) / path["path_m"] - 1
    row = [100 * ratio, path["end_error_percent"], 100 * path["ate_aligned_rmse_m"] / path["path_m"], imu_end]
    row += [aligned["objects"]["voxel_iou_mean_all"], objects["centre_within_68"], objects["centre_within_95"]]
    return job, [*row, objects["matched"]]


def show(name: str, row: list[float]) -> None:
    """One line of the table."""
    digits = (2, 2, 2, 2, 3, 2, 2, 0)
    cells = [f"{value:10.{d}f}" for value, d in zip(row, digits, strict=True)]
    print(f"{name:34s}" + "".join(cells), flush=True)


def summary(rows: np.ndarray) -> list[float]:
    """Means over the cases; shares within a region are those of all cars."""
    means = rows.mean(0)
    means[5:7] = (rows[:, 5:7] * rows[:, 7:]).sum(0) / rows[:, 7].sum()
    means[7] = rows[:, 7].sum()
    found: list[float] = means.tolist()
    return found


def main() -> None:
    """Run all, print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, default=ROOT / "benchmarks" / "out" / "slam_scale")
    parser.add_argument("--seeds", type=int, default=1, help="noise seeds of each start")
    parser.add_argument("--only", default="", help="cases whose name holds this")
    parser.add_argument("--starts", default=",".join(map(str, STARTS)), help="first frames in 06 and 07")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--record", action="store_true", help="write the figures to docs/results.json")
    a = parser.parse_args()
    a.work.mkdir(parents=True, exist_ok=True)
    starts = [int(start) for start in a.starts.split(",")]
    chosen = [job for job in jobs(a.work, starts, a.seeds) if a.only in job.name]
    kinds: dict[str, list[list[float]]] = {}
    print(f"{'':34s}" + "".join(f"{title:>10s}" for title in TITLES))
    with ProcessPoolExecutor(a.workers) as pool:
        for job, row in pool.map(partial(run, runs=a.work / "runs"), chosen):
            if isinstance(row, str):
                print(f"{job.name:34s} refused: {row}")
                continue
            show(job.name, row)
            kinds.setdefault(job.kind, []).append(row)
    print()
    for kind, rows in kinds.items():
        table = np.array(rows)
        better = int((table[:, 1] < table[:, 3]).sum())
        show(f"{kind}, mean", summary(table))
        spread = np.sqrt((table[:, 0] ** 2).mean())
        print(
            f"{'':34s}length off by {spread:.2f}% (root mean square), end error at most {table[:, 1].max():.2f}%, "
            f"better than the IMU in {better} of {len(table)}"
        )
        if a.record:
            names = ("length_percent", "end_error_percent", "ate_aligned_percent", "imu_end_error_percent")
            names += ("voxel_iou_aligned", "centre_within_68", "centre_within_95", "cars")
            figures = dict(zip(names, table.T.tolist(), strict=True))
            record(f"slam's scale, {kind}", "benchmarks/slam_scale.py", figures)


if __name__ == "__main__":
    main()
