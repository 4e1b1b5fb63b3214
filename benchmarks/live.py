"""Live SLAM against the offline command: does every frame have its pose in time, and is the path as good?

    python benchmarks/live.py SEQUENCE OUT [--truth POSES] [--rounds 3] [--record CASE] [-- FLAGS OF slam]

Runs `meshslam slam` once and `meshslam slam --live` some times, one after the other on an idle machine, and prints for
each: poses in time, what the network reached, end error and aligned ATE against the truth (KITTI's poses of the whole
drive by the frames' times, or groundtruth.tum of the sequence), and the process's memory through the run.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
from results import record

from meshslam.maps import Trajectory
from meshslam.sequences import read_path


def memory_mb(pid: int) -> float:
    """Resident memory of a process and its children, MiB; 0 when it has ended."""
    try:
        fields = Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()
    except (FileNotFoundError, ProcessLookupError):
        return 0.0
    return int(fields[1]) * 4096 / 1024**2


def run(command: list[str]) -> list[tuple[float, float]]:
    """Run a command; (seconds, MiB) every half second."""
    began_s, found = time.monotonic(), []
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        ended = threading.Event()

        def watch() -> None:
            while not ended.wait(0.5):
                found.append((time.monotonic() - began_s, memory_mb(process.pid)))

        watcher = threading.Thread(target=watch)
        watcher.start()
        code = process.wait()
        ended.set()
        watcher.join()
    if code not in (0, 3):
        raise SystemExit(f"{' '.join(command)} ended with {code}")
    return found


def errors(run_folder: Path, truth: Trajectory) -> tuple[float, float, float]:
    """Length in m, end error in % of it from the first pose on, aligned ATE in m."""
    found = Trajectory.load(run_folder / "trajectory.tum")
    nearest = [int(np.abs(truth.times_s - time_s).argmin()) for time_s in found.times_s]
    right = [truth.world_from_camera[i] for i in nearest]
    a = np.array([(right[0].inverse() @ pose).translation for pose in right])
    b = np.array([(found.world_from_camera[0].inverse() @ pose).translation for pose in found.world_from_camera])
    length_m = float(np.linalg.norm(np.diff(a, axis=0), axis=1).sum())
    u, _, v = np.linalg.svd((a - a.mean(0)).T @ (b - b.mean(0)))
    turn = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ v))]) @ v
    rest = (a - a.mean(0)) - (b - b.mean(0)) @ turn.T
    return length_m, 100 * float(np.linalg.norm(a[-1] - b[-1])) / length_m, float(np.sqrt((rest**2).sum(1).mean()))


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sequence", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--truth", type=Path, help="KITTI's NN.txt or TUM; groundtruth.tum of the sequence without it")
    parser.add_argument("--times", type=Path, help="times of KITTI's poses")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--record", help="write the live runs' figures to docs/results.json under this name")
    own, _, flags = " ".join(sys.argv[1:]).partition(" -- ")
    chosen = parser.parse_args(own.split())
    times_s, poses = read_path(chosen.truth or chosen.sequence / "groundtruth.tum", chosen.times)
    truth = Trajectory(times_s, tuple(poses))
    base = [sys.executable, "-m", "meshslam", "slam", str(chosen.sequence), *flags.split(), "--overwrite", "--out"]
    run([*base, str(chosen.out / "offline")])
    length_m, end, ate_m = errors(chosen.out / "offline", truth)
    print(f"{'':9} end error %  aligned ATE m  p50 / p95 / max s  segmented  taken in  start s  memory by thirds MiB")
    print(f"offline   {end:11.2f} {ate_m:14.3f}   ({length_m:.0f} m)")
    kept: dict[str, list[float]] = {"latency_p95_s": [], "end_error_percent": []}
    for k in range(chosen.rounds):
        folder = chosen.out / f"live{k}"
        memory = run([*base, str(folder), "--live"])
        _, end, ate_m = errors(folder, truth)
        f = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
        kept["latency_p95_s"].append(f["live_latency_p95_s"])
        kept["end_error_percent"].append(end)
        spans = np.array_split(np.array([mb for _, mb in memory if mb]), 3)
        thirds = " / ".join(f"{span.max():.0f}" for span in spans if len(span))
        latency = " / ".join(f"{f[f'live_latency_{key}_s']:.3f}" for key in ("median", "p95", "max"))
        print(
            f"live {k}    {end:11.2f} {ate_m:14.3f}   {latency}   {f['live_segmented_share']:.2f}       "
            f"{f['live_frames_taken_in']}/{f['live_frames']}   {f['live_start_work_s']:.2f}     {thirds}"
        )
    if chosen.record:
        record(chosen.record, "benchmarks/live.py", kept)


if __name__ == "__main__":
    main()
