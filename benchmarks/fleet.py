"""Twelve drives, two of them wrong: on Ray with a worker and a node killed, in local processes, and as single runs.

    .venv/bin/python benchmarks/fleet.py [--work FOLDER]

Needs the extra `ray`, and the data and tools that `$MESHSLAM_DATA` names (default ../shared/data, its tools beside it).
"""

from __future__ import annotations

import argparse
import json
import os
import secrets
import shutil
import subprocess
import sys
import time
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from tests.faults.harness import contents  # noqa: E402 # beside this folder
from tests.fleet.killing import killed_in_the_middle, raylet_of  # noqa: E402

DATA = Path(os.environ.get("MESHSLAM_DATA", ROOT.parent / "shared" / "data"))
COMMAND = (sys.executable, "-m", "meshslam")
KITTI = "2011_09_26"
DRIVE = f"{KITTI}_drive_0048_sync"
WRONG = ("poisoned", "bad_image")


def case(out: Path, kind: str, *arguments: object) -> Path:
    """A case by the tool that is none of our code."""
    command = [sys.executable, DATA.parent / "tools" / "make_case.py", kind, out, *arguments]
    subprocess.run([str(word) for word in command], check=True, capture_output=True)
    return out


def street(out: Path, number: str) -> Path:
    """Real car models at labelled boxes, along KITTI's path."""
    of = DATA / "kitti_tracking" / number
    given = ("--labels", of / "label_02.txt", "--poses", of / "poses.txt", "--intrinsics", of / "camera.yaml")
    return case(out, "street", *given, "--start", 0, "--frames", 60)


def along_06(out: Path, start: int, *more: object) -> Path:
    """Real car models beside KITTI 06's path and IMU."""
    of = DATA / "kitti_odometry"
    given = ("--poses", of / "poses" / "06.txt", "--times", of / "times_06.txt", "--imu", of / "imu" / "06.csv")
    return case(out, "localize", *given, "--start", start, "--frames", 40, "--cars", 4, *more)


def simulated(out: Path, seed: int) -> Path:
    """A street whose colours tell the cars."""
    subprocess.run(
        [*COMMAND, "simulate", str(out), "--frames", "20", "--seed", str(seed), "--mode", "contrast", "--quiet"],
        check=True,
    )
    return out


def kitti(out: Path, frames: int, *, cut: int | None = None) -> Path:
    """The first frames of the real drive, by links; the image `cut` is a part of itself."""
    source, drive = DATA / "kitti_raw" / KITTI, out / KITTI / DRIVE
    for part in ("image_02", "oxts"):
        (drive / part / "data").mkdir(parents=True)
        lines = (source / DRIVE / part / "timestamps.txt").read_text().splitlines()[:frames]
        (drive / part / "timestamps.txt").write_text("\n".join(lines) + "\n")
        for file in sorted((source / DRIVE / part / "data").iterdir())[:frames]:
            (drive / part / "data" / file.name).symlink_to(file)
    for file in source.glob("calib*.txt"):
        (out / KITTI / file.name).symlink_to(file)
    if cut is not None:
        image = sorted((drive / "image_02" / "data").iterdir())[cut]
        content = image.read_bytes()
        image.unlink()
        image.write_bytes(content[: len(content) // 2])
    return drive


def make_drives(work: Path) -> dict[str, tuple[str, Path, dict]]:
    """Command, recording and settings of twelve drives."""
    at, network = work / "drives", {"input": {"segmenter": str(DATA / "models" / "yolov5n-seg.onnx")}}
    at.mkdir(parents=True)
    wrong = case(at / "poisoned", "ring", "--views", 8, "--seed", 9)
    poses = (wrong / "poses.tum").read_text().splitlines()
    (wrong / "poses.tum").write_text("\n".join([*poses[:-1], poses[-1].replace(poses[-1].split()[1], "nan", 1)]) + "\n")
    return {
        "ring_0": ("map", case(at / "ring_0", "ring", "--views", 8, "--seed", 0), {}),
        "ring_1": ("map", case(at / "ring_1", "ring", "--views", 8, "--seed", 1), {}),
        "poisoned": ("map", wrong, {}),
        "street_0001": ("map", street(at / "street_0001", "0001"), {}),
        "street_0011": ("map", street(at / "street_0011", "0011"), {}),
        "bad_image": ("map", kitti(at / "bad_image", 22, cut=10), network),
        "kitti_0048": ("map", kitti(at / "kitti_0048", 22), network),
        "known_06": ("map", along_06(at / "known_06", 500, "--known-poses"), {}),
        "slam_06_100": ("slam", along_06(at / "slam_06_100", 100), {}),
        "slam_06_300": ("slam", along_06(at / "slam_06_300", 300), {}),
        "simulated_1": ("map", simulated(at / "simulated_1", 1), {"input": {"segmenter": "colour"}}),
        "simulated_2": ("slam", simulated(at / "simulated_2", 2), {}),
    }


def fleet(file: Path, out: Path, *more: str) -> subprocess.Popen[bytes]:
    """The command, with what it says beside its folder."""
    log = out.with_suffix(".log").open("ab")
    return subprocess.Popen([*COMMAND, "fleet", "run", str(file), "--out", str(out), *more], stdout=log, stderr=log)


def timed(process: subprocess.Popen[bytes]) -> float:
    """Seconds until it has ended, as a fleet with wrong drives does."""
    began_s = time.monotonic()
    if process.wait() != 1:
        sys.exit(f"exit code {process.returncode}, expected 1: see the log beside the folder")
    return time.monotonic() - began_s


def single_runs(drives: dict[str, tuple[str, Path, dict]], out: Path) -> float:
    """The good drives one after the other, by their commands."""
    began_s = time.monotonic()
    for name, (command, recording, settings) in drives.items():
        if name not in WRONG:
            chosen = ["--segmenter", settings["input"]["segmenter"]] if settings else []
            given = [*COMMAND, command, str(recording), *chosen, "--out", str(out / name), "--quiet"]
            subprocess.run(given, check=True, capture_output=True)
    return time.monotonic() - began_s


def on_ray(file: Path, out: Path, good: list[str]) -> tuple[float, list[str], list[str], float]:
    """Seconds with a worker and then a node killed, what they were at, a table, and seconds of the command again."""
    from ray.cluster_utils import Cluster

    os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_hex(32))
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    try:
        node = cluster.add_node(num_cpus=1)
        process = fleet(file, out, "--engine", "ray", "--address", cluster.address)
        began_s = time.monotonic()
        time.sleep(15.0)
        killed = [_killed(out, good, None)]
        time.sleep(15.0)
        killed.append(_killed(out, good, raylet_of(node)))
        timed(process)
        took_s = time.monotonic() - began_s
        rows = table(out)
        return took_s, killed, rows, timed(fleet(file, out, "--engine", "ray", "--address", cluster.address))
    finally:
        cluster.shutdown()


def _killed(out: Path, good: list[str], raylet: int | None) -> str:
    while (name := killed_in_the_middle(out, good, raylet)) is None:
        time.sleep(0.01)
    return name


def table(out: Path) -> list[str]:
    """A line a drive."""
    drives = json.loads((out / "fleet.json").read_text())["drives"]
    rows = []
    for drive in drives:
        figures, tasks = drive["figures"], drive["tasks"]
        seconds, memory = sum(t["seconds"] for t in tasks), max(t["peak_memory_mb"] for t in tasks)
        steps = " ".join(t["step"] + ("!" if t["how"].startswith("lost") else "") for t in tasks)
        count = figures.get("objects_mapped", "")
        rows.append(f"| {drive['name']} | {drive['how']} | {count} | {seconds:.1f} | {memory:.0f} | {steps} |")
    return [
        "| drive | ended | objects | seconds | peak MB | tasks (!: lost) |",
        "| --- | --- | --- | --- | --- | --- |",
        *rows,
    ]


def main() -> None:
    """Make, run, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, default=ROOT / "benchmarks" / "out" / "fleet")
    work = parser.parse_args().work
    shutil.rmtree(work, ignore_errors=True)
    drives = make_drives(work)
    good = [name for name in drives if name not in WRONG]
    entries = [{"name": n, "command": c, "recording": str(r), "settings": s} for n, (c, r, s) in drives.items()]
    file = work / "drives.yaml"
    file.write_text(yaml.safe_dump({"drives": entries}, sort_keys=False))
    single_s = single_runs(drives, work / "single")
    local_s = timed(fleet(file, work / "local"))
    ray_s, killed, rows, again_s = on_ray(file, work / "ray", good)
    carried_s = timed(fleet(file, work / "carried", "--no-shared-folder"))
    print(f"single runs {single_s:.0f} s; local {local_s:.0f} s; Ray, {' and '.join(killed)} killed, {ray_s:.0f} s;")
    print(f"again {again_s:.0f} s; local without a shared folder {carried_s:.0f} s")
    for engine in ("local", "ray", "carried"):
        same = [contents(work / "single" / n) == contents(work / engine / "runs" / n) for n in good]
        print(f"{engine}: {sum(same)} of {len(good)} good drives there, to the bytes of single runs")
    print("\n".join(rows))


if __name__ == "__main__":
    main()
