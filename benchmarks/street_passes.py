"""Two passes of a street of KITTI's labelled cars: there, and back in the other lane, for benchmarks/merge.py."""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
from localize import DATA, TOOLS, tum

from meshslam.geometry import Pose

LANE_M = 3.0  # between the lanes
HOW = ("given poses", "no ids", "slam")


def case_tool() -> ModuleType:
    """The script that draws cases and is none of our code."""
    spec = importlib.util.spec_from_file_location("make_case", TOOLS / "make_case.py")
    assert spec is not None
    assert spec.loader is not None
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    return tool


def make_pass(out: Path, street: tuple[str, int, int], *, back: bool, how: str) -> None:
    """A pass of a street (sequence, first frame, frames), in a world turned and moved by chance."""
    tool, (number, start, frames), of = case_tool(), street, DATA / "kitti_tracking" / street[0]
    write, rng = tool.write_case, np.random.default_rng([11, int(number), start, int(back)])
    moved = Pose.from_yaw(rng.uniform(-np.pi, np.pi), np.append(rng.uniform(-300, 300, 2), rng.uniform(-5, 5))).matrix

    def changed(a: Any, k: Any, times: Any, poses: Any, objects: Any, noise: Any, **rest: Any) -> None:
        path = [reversed_pose(pose) for pose in poses[::-1]] if back else poses
        for thing in objects:
            thing["pose"] = moved @ thing["pose"]
        known = how != "slam"
        write(a, k, times, [moved @ pose for pose in path], objects, noise, **{**rest, "known_poses": known})
        if not known:
            (out / "poses.tum").write_text(tum(times, odometry([moved @ pose for pose in path], rng)))

    tool.write_case = changed
    a = SimpleNamespace(
        out=out,
        kind="street",
        poses=str(of / "poses.txt"),
        labels=str(of / "label_02.txt"),
        intrinsics=str(of / "camera.yaml"),
        start=start,
        frames=frames,
        clean=False,
        ids=how != "no ids",
        noise=np.random.default_rng([1, start + int(back)]),
    )
    tool.street(a, tool.load_cars(DATA / "cars"), np.random.default_rng(0))
    (out / "moved.json").write_text(json.dumps(moved.tolist()))


def reversed_pose(pose: np.ndarray) -> np.ndarray:
    """The camera in the lane to the left, looking back."""
    found, turn = pose.copy(), np.diag([-1.0, -1.0, 1.0])
    found[:3, 3] -= LANE_M * pose[:3, 0]
    found[:3, :3] = turn @ pose[:3, :3]
    return found


def odometry(poses: list[np.ndarray], rng: np.random.Generator) -> list[np.ndarray]:
    """Poses of which each step is off by 1% of its length and 0.05 degrees."""
    from scipy.spatial.transform import Rotation

    found = [poses[0]]
    for one, other in pairwise(poses):
        step = np.linalg.inv(one) @ other
        step[:3, 3] *= 1 + rng.normal(0, 0.01)
        step[:3, :3] = step[:3, :3] @ Rotation.from_rotvec(np.radians(rng.normal(0, 0.05, 3))).as_matrix()
        found.append(found[-1] @ step)
    return found


def street_row(street: tuple[str, int, int], how: str, work: Path) -> dict[str, Any]:
    """Both passes mapped, or by SLAM, merged, and scored: cars that both show, alone and together."""
    folder = work / f"street_{street[0]}_{street[1]}_{how.replace(' ', '_')}"
    cases, runs = ([folder / kind / name for name in ("there", "back")] for kind in ("cases", "runs"))
    for case, run, back in zip(cases, runs, (False, True), strict=True):
        if not (case / "moved.json").is_file():
            case.parent.mkdir(parents=True, exist_ok=True)
            make_pass(case, street, back=back, how=how)
        command = ("slam", case, "--poses", "odometry") if how == "slam" else ("map", case)
        meshslam(*command, "--out", run)
    meshslam("merge", *runs, "--out", folder / "city", "--overwrite")
    return figures(folder, cases, runs, how)


def figures(folder: Path, cases: list[Path], runs: list[Path], how: str) -> dict[str, Any]:
    """Scores by the script that is none of our code."""
    flags = ("--align",) if how == "slam" else ()
    alone = [score(case, run, *flags) for case, run in zip(cases, runs, strict=True)]
    merged = score(cases[0], as_run(folder, runs[0]), *flags)
    ious = [{row["id"]: row["voxel_iou"] for row in one["objects"]} for one in (*alone, merged)]
    both = sorted(ious[0].keys() & ious[1].keys() & ious[2].keys())
    mean = [float(np.mean([of[number] for number in both])) for of in ious]
    return {
        "street": folder.name,
        "cars": f"{alone[0]['matched']}, {alone[1]['matched']} > {merged['estimated']}",
        "seen in both": len(both),
        "twice": merged["duplicates"],
        "IoU there, back": f"{mean[0]:.3f}, {mean[1]:.3f}",
        "IoU merged": f"{mean[2]:.3f}",
        "centre m": f"{alone[0]['centre_error_median_m']:.3f} > {merged['centre_error_median_m']:.3f}",
        "each": {n: [round(of[n], 2) for of in ious] for n in both},
    }


def as_run(folder: Path, first: Path) -> Path:
    """The merged map with the path of its first drive, as the scorer takes it."""
    out = folder / "scored"
    shutil.rmtree(out, ignore_errors=True)
    shutil.copytree(folder / "city", out)
    shutil.copy(folder / "city" / "trajectories" / f"{first.name}.tum", out / "trajectory.tum")
    return out


def score(case: Path, run: Path, *flags: str) -> dict[str, Any]:
    """Of the objects."""
    command = [sys.executable, str(TOOLS / "score_run.py"), str(case), str(run), *flags]
    found: dict[str, Any] = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    return dict(found["objects"])


def meshslam(*arguments: object) -> None:
    """A command."""
    subprocess.run([sys.executable, "-m", "meshslam", *map(str, arguments), "--quiet"], check=True)
