"""Several passes of one street, each in a world of its own, merged and held against the truth.

    .venv/bin/python benchmarks/merge.py [--streets 0:100 1:300] [--work FOLDER]
    .venv/bin/python benchmarks/merge.py --street 0001:0:120 0011:120:100 [--how "given poses" "no ids" slam]

The second form is for streets of KITTI's labelled cars, passed there and back: what one pass and two say of the shapes.

Needs the data and tools that `$MESHSLAM_DATA` names (default ../shared/data, its tools beside it): cases are drawn and
scored by scripts that are none of our code. A street has passes with the camera moved aside, other noise and other
start frames; in the last one, a car stands elsewhere and another has left. Of four passes, the truth is the last one's.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from street_passes import HOW, street_row

from meshslam.geometry import Pose
from meshslam.maps import Trajectory

ROOT = Path(__file__).resolve().parent.parent
DATA = Path(os.environ.get("MESHSLAM_DATA", ROOT.parent / "shared" / "data"))
TOOLS = DATA.parent / "tools"
PASSES = (  # metres aside, frames that are used, whether cars have changed
    ("first", 0.0, "0:70", False),
    ("other side", 8.0, "0:70", False),
    ("later start", 1.2, "12:70", False),
    ("last", -1.2, "0:62", True),
)
MOVED, GONE, MOVED_M = 4, 7, 1.3  # the cars (by place in the list), and how far


def make_pass(out: Path, number: int, seed: int, start: int) -> None:
    """One pass of a street, in a world turned and moved by chance."""
    spec = importlib.util.spec_from_file_location("make_case", TOOLS / "make_case.py")
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    _, lateral, _, changes = PASSES[number]
    write = tool.write_case
    rng = np.random.default_rng([7, seed, number])
    moved = Pose.from_yaw(rng.uniform(-np.pi, np.pi), np.append(rng.uniform(-300, 300, 2), rng.uniform(-5, 5))).matrix

    def changed(a, k, times, poses, objects, noise, **rest):
        rest["extra"] = {}  # neither IMU nor start: poses are known
        if changes:
            for o in objects[MOVED : MOVED + 1]:
                o["pose"] = o["pose"].copy()
                o["pose"][:3, 3] += MOVED_M * o["pose"][:3, 0]
            objects = [o for i, o in enumerate(objects) if i != GONE]
        for o in objects:
            o["pose"] = moved @ o["pose"]
        return write(a, k, times, [moved @ p for p in poses], objects, noise, **rest)

    tool.write_case = changed
    kitti = DATA / "kitti_odometry"
    a = SimpleNamespace(
        out=out,
        kind="localize",
        poses=str(kitti / "poses" / "06.txt"),
        times=str(kitti / "times_06.txt"),
        imu=str(kitti / "imu" / "06.csv"),
        start=start,
        frames=70,
        cars=14,
        seed=seed,
        noise_seed=100 * seed + number,
        lateral=lateral,
        known_poses=True,
        shift_map=0.0,
        wrong_ids=0.0,
        clean=False,
        ids=True,
        noise=np.random.default_rng([1, 100 * seed + number]),
    )
    tool.localize(a, tool.load_cars(DATA / "cars"), np.random.default_rng(seed))
    (out / "moved.json").write_text(json.dumps(moved.tolist()))


def score(case: Path, run: Path) -> dict:
    """Figures by the independent scorer."""
    command = [sys.executable, TOOLS / "score_run.py", case, run]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)["objects"]


def world_of(case: Path) -> Pose:
    """Where the street lies in the case's world."""
    return Pose.from_matrix(np.array(json.loads((case / "moved.json").read_text())))


def truth_of(city: Path, cases: list[Path]) -> Path:
    """The cars of the last pass, in the first one's world."""
    folder = city.with_name(f"{city.name}-truth")
    folder.mkdir(exist_ok=True)
    first_from_last = world_of(cases[0]) @ world_of(cases[-1]).inverse()
    document = json.loads((cases[-1] / "objects.json").read_text())
    for thing in document["objects"]:
        thing["world_from_object"] = (first_from_last.matrix @ np.array(thing["world_from_object"])).tolist()
        thing["mesh"] = str((cases[-1] / thing["mesh"]).resolve())
    (folder / "objects.json").write_text(json.dumps(document))
    shown = [json.loads((case / "association.json").read_text()).values() for case in cases]
    everything = [number for numbers in shown for number in numbers]
    (folder / "association.json").write_text(json.dumps(dict(enumerate(everything))))
    return folder


def meshslam(*arguments) -> None:
    subprocess.run([sys.executable, "-m", "meshslam", *map(str, arguments), "--quiet"], check=True)


def drifts(city: Path, cases: list[Path], runs: list[Path]) -> tuple[float, float]:
    """The largest RMSE of a drive's path in the common world, m, and of its rotation, degrees."""
    first = world_of(cases[0])
    found = []
    for case, run in zip(cases, runs, strict=True):
        own = world_of(case)
        merged = Trajectory.load(city / "trajectories" / f"{run.name}.tum")
        true = [first @ own.inverse() @ pose for pose in Trajectory.load(run / "trajectory.tum").world_from_camera]
        steps = np.array([a.local(b) for a, b in zip(true, merged.world_from_camera, strict=True)])
        found.append(np.sqrt((steps**2).reshape(len(steps), 2, 3).sum(2).mean(0)))
    largest = np.max(found, axis=0)
    return float(largest[0]), float(np.degrees(largest[1]))


def told(city: Path, kind: str) -> set[int]:
    """Cars with a status, by their true numbers, which the runs keep."""
    cars = json.loads((city / "visits.json").read_text())["cars"]
    return {v["id"] for car in cars if car["status"] == kind for v in car["visits"] if "id" in v}


def row(name: str, city: Path, cases: list[Path], runs: list[Path], changes: bool) -> dict:
    visits = json.loads((city / "visits.json").read_text())["cars"]
    several = {v["id"] for c in visits if sum("id" in v for v in c["visits"]) > 1 for v in c["visits"] if "id" in v}
    alone = [score(case, run) for case, run in zip(cases, runs, strict=True)]
    merged = score(truth_of(city, cases), city)
    scores = {r["id"]: r["voxel_iou"] for r in merged["objects"] if r["id"] in several}
    single = [r["voxel_iou"] for one in alone for r in one["objects"] if r["id"] in several]
    drift_m, drift_deg = drifts(city, cases, runs)
    within = [one[f"centre_within_{share}"] for share in (68, 95) for one in alone]
    count, centres = len(alone), [one["centre_error_median_m"] for one in alone]
    changed = f"{sorted(told(city, 'moved'))} {sorted(told(city, 'gone'))}" if changes else "-"
    expected = "moved, gone" if changes else "none"
    return {
        "street": name,
        "drives": count,
        "cars": f"{merged['estimated']}/{merged['true']}",
        "extra": merged["extra"],
        "twice": merged["duplicates"],
        "drift m": f"{drift_m:.3f}",
        "drift deg": f"{drift_deg:.3f}",
        "IoU single": f"{np.mean(single):.3f}",
        "IoU merged": f"{np.mean(list(scores.values())):.3f}",
        "centre m": f"{np.mean(centres):.3f} > {merged['centre_error_median_m']:.3f}",
        "68 / 95": f"{np.mean(within[:count]):.2f} / {np.mean(within[count:]):.2f} > "
        f"{merged['centre_within_68']:.2f} / {merged['centre_within_95']:.2f}",
        expected: changed,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--streets", nargs="+", default=["0:100", "1:300", "2:500"], help="seed:first frame of drive 06"
    )
    parser.add_argument("--street", nargs="+", default=[], help="sequence:first frame:frames of KITTI tracking")
    parser.add_argument("--how", nargs="+", choices=HOW, default=HOW, help="what the passes of --street are given")
    parser.add_argument("--work", type=Path, default=ROOT / "benchmarks" / "out" / "merge")
    a = parser.parse_args()
    if a.street:
        for street in a.street:
            number, start, frames = street.split(":")
            for how in a.how:
                print(street_row((number, int(start), int(frames)), how, a.work), flush=True)
        return
    rows = []
    for street in a.streets:
        seed, start = map(int, street.split(":"))
        cases = [a.work / f"{seed}-{start}" / "cases" / f"pass{k}" for k in range(len(PASSES))]
        runs = [a.work / f"{seed}-{start}" / f"pass{k}" for k in range(len(PASSES))]
        for k, (case, run) in enumerate(zip(cases, runs, strict=True)):
            if not (case / "moved.json").is_file():
                case.parent.mkdir(parents=True, exist_ok=True)
                make_pass(case, k, seed, start)
            meshslam("map", case, "--out", run, "--frames", PASSES[k][2])
        for count in (2, 4):
            city = a.work / f"{seed}-{start}" / f"city{count}"
            meshslam("merge", *runs[:count], "--out", city, "--overwrite")
            rows.append(row(street, city, cases[:count], runs[:count], changes=count == 4))
            print(rows[-1], flush=True)
    for r in rows:
        print(" | ".join(map(str, r.values())))


if __name__ == "__main__":
    main()
