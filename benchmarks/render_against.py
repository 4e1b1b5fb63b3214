"""Two builds of the renderer in turn: each runs in a process of its own and is asked for a round at a time (A B A B).

A process is this file, run with the sources and the build of one checkout; it gets meshes from this one, so that of an
older one it needs only `geometry`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from render_cases import DISTANCES_M, Mesh, box_around, cropped_loss, observed_at, pose_at

from meshslam.geometry import MaskLoss, Pose, mask_gradients

Times = dict[str, list[float]]
VIEWS = 64
ROTATION_STEP_RAD = 2 * np.pi / VIEWS


def called(loss: MaskLoss, pose: Pose, mesh: Mesh) -> float:
    """Seconds of a call from Python."""
    start = time.perf_counter()
    loss.gradient(pose, mesh.vertices)
    return time.perf_counter() - start


class Rounds:
    """The cases of a build."""

    def __init__(self, mesh: Mesh, large: Mesh) -> None:
        self.mesh, self.large = mesh, large
        half = mesh.faces[mesh.vertices[mesh.faces][:, :, 1].mean(1) > 0]
        self.open = Mesh(mesh.vertices, half)
        self.losses = {d: cropped_loss(self.mesh, observed_at(self.mesh, d)) for d in DISTANCES_M}
        self.of_large = cropped_loss(self.large, observed_at(self.large, 15.0))
        self.of_open = cropped_loss(self.open, observed_at(self.open, 15.0))
        yaws = ROTATION_STEP_RAD * np.arange(VIEWS) + 0.3
        distances = np.linspace(8.0, 30.0, VIEWS)
        self.poses = [pose_at(d, y) for d, y in zip(distances, yaws, strict=True)]
        masks = [observed_at(self.mesh, d, y + 0.05) for d, y in zip(distances, yaws, strict=True)]
        self.views = [cropped_loss(self.mesh, mask, box_around(mask)) for mask in masks]

    def run(self) -> Times:
        """Seconds of one round."""
        found: Times = {}
        for d, loss in self.losses.items():
            pose = pose_at(d)
            found[f"one view, {d:.0f} m"] = loss.seconds(pose, self.mesh.vertices, 20)
            found[f"from Python, {d:.0f} m"] = [called(loss, pose, self.mesh) for _ in range(20)]
            moved = [Mesh(self.mesh.vertices * (1 + 1e-9 * k), self.mesh.faces) for k in range(1, 11)]
            found[f"from Python, new vertices, {d:.0f} m"] = [called(loss, pose, mesh) for mesh in moved]
        found["open mesh, 15 m"] = self.of_open.seconds(pose_at(15.0), self.open.vertices, 10)
        found[f"{len(self.large.faces)} faces, 15 m"] = self.of_large.seconds(pose_at(15.0), self.large.vertices, 6)
        for threads in (1, 2):
            start = time.perf_counter()
            mask_gradients(self.views, self.poses, self.mesh.vertices, threads)
            found[f"{VIEWS} views, threads: {threads}"] = [time.perf_counter() - start]
        return found


def start(checkout: Path, meshes: Path) -> subprocess.Popen[str]:
    """A process with the package of a checkout."""
    environment = os.environ | {"PYTHONPATH": str(checkout.resolve() / "python")}
    command = [sys.executable, __file__, str(meshes)]
    return subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def ask(process: subprocess.Popen[str]) -> Times:
    """A round of a process."""
    assert process.stdin is not None
    assert process.stdout is not None
    print("round", file=process.stdin, flush=True)
    return json.loads(process.stdout.readline())


def in_turn(checkouts: tuple[Path, Path], mesh: Mesh, large: Mesh, rounds: int) -> list[Times]:
    """Seconds of the rounds of two checkouts."""
    found: list[Times] = [{}, {}]
    with tempfile.TemporaryDirectory() as folder:
        meshes = Path(folder) / "meshes.npz"
        np.savez(meshes, v=mesh.vertices, f=mesh.faces, large_v=large.vertices, large_f=large.faces)
        processes = [start(checkout, meshes) for checkout in checkouts]
        for turn in range(rounds + 1):
            for process, times in zip(processes, found, strict=True):
                for name, values in ask(process).items():
                    if turn > 0:  # the first round fills caches
                        times.setdefault(name, []).extend(values)
        for process in processes:
            process.communicate()
    return found


def against(ours: Path, theirs: Path, mesh: Mesh, large: Mesh, rounds: int) -> list[dict[str, float | str]]:
    """Compare two checkouts; prints a table and returns its rows, times in microseconds."""
    sums = in_turn((ours, theirs), mesh, large, rounds)
    rows: list[dict[str, float | str]] = []
    print("| what | this, us | other, us | times as fast |\n| --- | --- | --- | --- |")
    for name in sums[0]:
        here, there = (1e6 * np.array(times[name]) for times in sums)
        row = {"name": name, "us": float(here.min()), "median_us": float(np.median(here))}
        row |= {"other_us": float(there.min()), "other_median_us": float(np.median(there))}
        rows.append(row)
        fast, by_medians = row["other_us"] / row["us"], row["other_median_us"] / row["median_us"]
        print(
            f"| {name} | {row['us']:.2f} ({row['median_us']:.2f}) "
            f"| {row['other_us']:.2f} ({row['other_median_us']:.2f}) | {fast:.2f} ({by_medians:.2f}) |"
        )
    return rows


if __name__ == "__main__":
    given = np.load(sys.argv[1])
    cases = Rounds(Mesh(given["v"], given["f"]), Mesh(given["large_v"], given["large_f"]))
    for _ in sys.stdin:
        print(json.dumps(cases.run()), flush=True)
