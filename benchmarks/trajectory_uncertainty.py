"""Whether the covariances of camera poses are as large as the errors are: NEES over simulated drives.

    .venv/bin/python benchmarks/trajectory_uncertainty.py [--seeds 20] [--as-made] [--work FOLDER]

A drive is KITTI 06's path among real car models, with masks and key points by a tool that is none of our code. All
that the estimator is told the uncertainty of is drawn from just that: the IMU's noise and biases, the first pose and
velocity, the camera's mounting and clock. With `--as-made` the recorded IMU and an exact start are used instead.

NEES (Bar-Shalom et al. 2001): e^T C^-1 e over its dimension, e = estimate.local(truth) being the error that the
covariance C is of. It is 1 in the mean where C is right, below 1 where C is too large.

Needs the data and tools that `$MESHSLAM_DATA` names (default ../shared/data, its tools beside it).
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import yaml

import meshslam
from meshslam.geometry import Pose, exp_so3
from meshslam.perception import read_detections
from meshslam.sequences import ImuSamples
from meshslam.simulation import ImuNoise, simulated_imu

ROOT = Path(__file__).resolve().parent.parent
DATA = Path(os.environ.get("MESHSLAM_DATA", ROOT.parent / "shared" / "data"))
DRAWN = meshslam.Config()
DRAWN = replace(DRAWN, slam=replace(DRAWN.slam, gyroscope_noise=DRAWN.estimation.imu.gyroscope_noise))


def made(work: Path, seed: int) -> Path:
    """A drive of 70 frames by the tool, made once."""
    case, odometry = work / f"made_{seed}", DATA / "kitti_odometry"
    if not (case / "objects.json").is_file():
        paths = ["--poses", odometry / "poses" / "06.txt", "--times", odometry / "times_06.txt"]
        command = [sys.executable, DATA.parent / "tools" / "make_case.py", "localize", case, *paths]
        command += ["--imu", odometry / "imu" / "06.csv", "--start", 3 + 53 * seed % 1000, "--frames", 70]
        command += ["--cars", 5 + seed % 4, "--seed", seed]
        subprocess.run([str(word) for word in command], check=True, capture_output=True)
    return case


def drawn(case: Path, target: Path, seed: int, command: str) -> Path:
    """The same drive, what the estimator is told of IMU, start, mounting and clock being drawn from its sigmas."""
    shutil.copytree(case, target, dirs_exist_ok=True)
    rng = np.random.default_rng([seed, 7, command == "slam"])
    estimation, slam = DRAWN.estimation, DRAWN.slam
    told = slam if command == "slam" else estimation.imu
    truth = meshslam.Trajectory.load(case / "groundtruth.tum")
    camera = yaml.safe_load((case / "camera.yaml").read_text())
    mounted = Pose.from_matrix(np.array(camera["imu_from_camera"]))
    readings = simulated_imu(truth.times_s, truth.world_from_camera, mounted, ImuNoise(), rng)
    clock_s = rng.normal(0.0, told.time_offset_sigma_s)
    turn = exp_so3(rng.normal(0.0, np.radians(told.extrinsic_rotation_sigma_deg), 3))
    camera["imu_from_camera"] = Pose(mounted.rotation @ turn, mounted.translation).matrix.tolist()
    (target / "camera.yaml").write_text(yaml.safe_dump(camera, default_flow_style=None))
    samples = readings.samples
    rows = np.column_stack([samples.times_s - clock_s, samples.angular_rate_rad_s, samples.specific_force_m_s2])
    header = "timestamp,wx,wy,wz,ax,ay,az"
    np.savetxt(target / "imu.csv", rows, fmt="%.9f", delimiter=",", header=header, comments="")
    start, first = estimation.start, truth.world_from_camera[0]
    tilt, heading = np.radians([start.rotation_sigma_deg, start.heading_sigma_deg])
    pose = Pose(
        exp_so3(rng.normal(0.0, [tilt, tilt, heading])) @ first.rotation,
        first.translation + rng.normal(0.0, start.position_sigma_m, 3),
    )
    velocity = readings.velocity_in_world + rng.normal(0.0, start.velocity_sigma_m_s, 3)
    document = {"timestamp": float(truth.times_s[0]), "world_from_camera": pose.matrix.tolist()}
    document["velocity_in_world"] = velocity.tolist()
    (target / "initial_state.yaml").write_text(yaml.safe_dump(document, default_flow_style=None))
    return target


def nees(path: Sequence[Pose], covariances: Sequence[np.ndarray], truth: Sequence[Pose]) -> np.ndarray:
    """Mean over the frames: of all, of position, of rotation, and of each axis by itself (9,)."""
    rows = []
    for pose, covariance, true in zip(path, covariances, truth, strict=True):
        error = pose.local(true)
        parts = [slice(0, 6), slice(0, 3), slice(3, 6)]
        rows.append(
            [error[p] @ np.linalg.solve(covariance[p, p], error[p]) / len(error[p]) for p in parts]
            + (error**2 / np.diag(covariance)).tolist()
        )
    return np.mean(rows, axis=0)


def run(command: str, drive: Path) -> dict[str, np.ndarray]:
    """NEES of a drive: of each pose when its frame came, and of the whole path at the end."""
    recording = meshslam.open_sequence(drive)
    truth = meshslam.Trajectory.load(drive / "groundtruth.tum").world_from_camera
    detections = read_detections(drive / "detections.json").by_frame()
    told = {"imu_from_camera": recording.imu_from_camera, "start": recording.initial_state, "config": DRAWN}
    scene = meshslam.Map.load(drive / "objects.json")
    if command == "slam":
        stream = meshslam.Slam(recording.camera, height_above_ground_m=recording.height_above_ground_m, **told)
    else:
        stream = meshslam.Localizer(recording.camera, scene, **told)
    live, imu, last_s = [], recording.imu, -np.inf
    for frame, time_s in zip(recording.frame_ids, recording.times_s.tolist(), strict=True):
        new = (imu.times_s > last_s) & (imu.times_s <= time_s + 0.011)
        last_s = time_s + 0.011
        samples = ImuSamples(imu.times_s[new], imu.angular_rate_rad_s[new], imu.specific_force_m_s2[new])
        live.append(stream.process(time_s=time_s, frame=frame, imu=samples, detections=detections.get(frame, ())))
    result = (
        meshslam.slam(recording, config=DRAWN)
        if command == "slam"
        else meshslam.localize(recording, scene, config=DRAWN)
    )
    begun = [(state, true) for state, true in zip(live, truth, strict=True) if state.is_started]
    poses, covariances = zip(*((state.world_from_camera, state.camera_covariance) for state, _ in begun), strict=True)
    estimate = result.estimate
    return {
        "live": nees(poses, covariances, [true for _, true in begun]),
        "end": nees(estimate.trajectory.world_from_camera, estimate.covariances, truth),
    }


def one(given: tuple[str, int, Path, bool]) -> dict[str, np.ndarray]:
    """A seed's drive, made and run."""
    command, seed, work, as_made = given
    case = made(work, seed)
    return run(command, case if as_made else drawn(case, work / f"{command}_{seed}", seed, command))


def main() -> None:
    """Run the seeds and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--as-made", action="store_true", help="the recorded IMU, an exact start, mounting and clock")
    parser.add_argument("--work", type=Path, default=ROOT / "build" / "trajectory_uncertainty")
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    jobs = [(c, s, options.work, options.as_made) for c, s in product(("localize", "slam"), range(options.seeds))]
    for seed in range(options.seeds):
        made(options.work, seed)
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        found = list(pool.map(one, jobs))
    names = ("both", "position", "rotation", "x", "y", "z", "about x", "about y", "about z")
    print("| command | when | " + " | ".join(names) + " |\n" + "| --- " * 11 + "|")
    for command, when in product(("localize", "slam"), ("live", "end")):
        rows = [row[when] for job, row in zip(jobs, found, strict=True) if job[0] == command]
        print(f"| {command} | {when} | " + " | ".join(f"{value:.2f}" for value in np.mean(rows, axis=0)) + " |")


if __name__ == "__main__":
    main()
