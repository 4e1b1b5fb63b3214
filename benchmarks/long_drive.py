"""A drive as long as you like: what `map` takes of time and memory by its length, and beside another checkout.

    .venv/bin/python benchmarks/long_drive.py [--frames 240 2500 5000 10000] [--work FOLDER] [--record]
    .venv/bin/python benchmarks/long_drive.py --frames 240 --against FOLDER [--rounds 2]

A street with real car models (KITTI tracking 0011) is driven again and again, each time further on: the camera leaves
it straight ahead and enters the next one, whose cars are new ones. Poses and detections with track ids are given, there
are no images. `--no-ids` leaves the ids out. Of two checkouts each runs once, then each again: the folder has its
`python/` with the compiled core. Needs the data and tools that `$MESHSLAM_DATA` names (default ../shared/data, its
tools beside it).
"""

from __future__ import annotations

import argparse
import copy
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from localize import DATA, ROOT, TOOLS, tum
from results import record
from scipy.spatial.transform import Rotation

STREET = "0011"
STREET_FRAMES = 373
GAP_M, STEP_M = 100.0, 2.0  # between two streets: no car of one is seen from the other
INTERVAL_S = 0.1


@dataclass(frozen=True)
class Street:
    """The case that is repeated: poses (n, 4, 4) of world_from_camera, and its files."""

    poses: np.ndarray
    camera: str
    document: dict[str, Any]
    objects: list[dict[str, Any]]
    folder: Path

    @property
    def length(self) -> int:
        """Frames of a street with the way to the next."""
        return len(self.poses) + int(GAP_M / STEP_M)

    @property
    def last_id(self) -> int:
        """The largest number of a car."""
        return max(int(thing["id"]) for thing in self.objects)


def street(work: Path, *more: str) -> Street:
    """One street, by the tool that is none of our code; made once."""
    folder, of = work / "-".join((f"street-{STREET}", *more)), DATA / "kitti_tracking" / STREET
    if not (folder / "objects.json").is_file():
        given = ("--labels", of / "label_02.txt", "--poses", of / "poses.txt", "--intrinsics", of / "camera.yaml")
        command = [sys.executable, TOOLS / "make_case.py", "street", folder, *given, "--frames", STREET_FRAMES, *more]
        subprocess.run([str(word) for word in command], check=True, capture_output=True)
    rows = np.loadtxt(folder / "poses.tum")
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, 3], poses[:, :3, :3] = rows[:, 1:4], Rotation.from_quat(rows[:, 4:]).as_matrix()
    return Street(
        poses,
        (folder / "camera.yaml").read_text(),
        json.loads((folder / "detections.json").read_text()),
        json.loads((folder / "objects.json").read_text())["objects"],
        folder,
    )


def laid(one: Street, frames: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Poses of the whole drive, and where each street lies: drive_from_street."""
    at, path, places = np.eye(4), [], []
    while len(path) < frames:
        places.append(at)
        path += list(at @ one.poses)
        last, yaw = path[-1], np.arctan2(path[-1][1, 2], path[-1][0, 2])
        ahead = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        for step in range(1, one.length - len(one.poses) + 1):
            pose = last.copy()
            pose[:3, 3] += step * STEP_M * ahead
            path.append(pose)
        at = np.eye(4)
        at[:3, :3] = Rotation.from_euler("z", yaw).as_matrix()
        at[:3, 3] = path[-1][:3, 3] + STEP_M * ahead
    return path[:frames], places


def annotations(one: Street, streets: int, frames: int) -> Iterator[dict[str, Any]]:
    """Those of the street, again and again: ids, frames and tracks go on."""
    number = 0
    for k in range(streets):
        for row in one.document["annotations"]:
            frame = row["image_id"] + k * one.length
            if frame >= frames:
                break  # they are by frame
            number += 1
            moved = {**row, "id": number, "image_id": frame}
            if "track_id" in row:
                moved["track_id"] = row["track_id"] + k * (one.last_id + 1)
            yield moved


def make(folder: Path, one: Street, frames: int, *, truth: bool) -> Path:
    """A sequence folder of so many frames; `truth`: with objects.json, so that it can be scored."""
    if (folder / "detections.json").is_file():
        return folder
    folder.mkdir(parents=True, exist_ok=True)
    path, places = laid(one, frames)
    times_s = INTERVAL_S * np.arange(frames)
    (folder / "camera.yaml").write_text(one.camera)
    (folder / "times.txt").write_text("".join(f"{t:.9f}\n" for t in times_s))
    (folder / "poses.tum").write_text(tum(times_s, path))
    if truth:
        _write_truth(folder, one, places)
        truth_of = {row["id"]: row["track_id"] for row in annotations(one, len(places), frames)}
        (folder / "association.json").write_text(json.dumps(truth_of))
    size = {key: one.document["images"][0][key] for key in ("width", "height")}
    images = [{"id": i, "file_name": f"{i:06d}.png", **size} for i in range(frames)]
    head = json.dumps({"images": images, "categories": one.document["categories"]})
    part = folder / "detections.json.part"
    with part.open("w", encoding="utf-8") as file:
        file.write(head[:-1] + ', "annotations": [\n')
        for k, row in enumerate(annotations(one, len(places), frames)):
            file.write((",\n" if k else "") + json.dumps(row))
        file.write("\n]}\n")
    part.replace(folder / "detections.json")
    return folder


def _write_truth(folder: Path, one: Street, places: list[np.ndarray]) -> None:
    (folder / "meshes").mkdir(exist_ok=True)
    for mesh in (one.folder / "meshes").iterdir():
        os.link(mesh, folder / "meshes" / mesh.name)
    things = []
    for k, place in enumerate(places):
        for thing in one.objects:
            moved = copy.deepcopy(thing)
            moved["id"] += k * (one.last_id + 1)
            moved["world_from_object"] = (place @ np.array(thing["world_from_object"])).tolist()
            things.append(moved)
    (folder / "objects.json").write_text(json.dumps({"objects": things}))


@dataclass(frozen=True)
class Taken:
    """What a run took."""

    seconds: float
    cpu_seconds: float
    peak_mb: float
    figures: dict[str, Any]


def run(checkout: Path, drive: Path, out: Path, *more: str) -> Taken:
    """`map` by a checkout, in a process of its own."""
    place = {"PYTHONPATH": str(checkout / "python"), "MESHSLAM_RECORDING": "0"}
    command = [sys.executable, "-m", "meshslam", "map", str(drive), "--out", str(out), "--overwrite", *more]
    began_s = time.perf_counter()
    process = subprocess.Popen(
        command, env={**os.environ, **place}, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    _, status, used = os.wait4(process.pid, 0)
    if status:
        sys.exit(f"{' '.join(command)}: ended with status {status}")
    figures = json.loads((out / "metrics.json").read_text())
    return Taken(time.perf_counter() - began_s, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024, figures)


def line(name: str, frames: int, taken: Taken) -> str:
    """One row of the table."""
    objects, each_ms = taken.figures["objects_mapped"], 1e3 / frames
    times = f"{taken.seconds:8.1f} s {each_ms * taken.seconds:7.1f} ms {each_ms * taken.cpu_seconds:7.1f} ms"
    return f"{name:<24} {frames:>7} {objects:>8} {times} {taken.peak_mb:8.0f} MB"


HEAD = f"{'':<24} {'frames':>7} {'objects':>8} {'wall':>10} {'per frame':>10} {'its CPU':>10} {'peak':>11}"


def main() -> None:
    """Make the drives, map them, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, nargs="+", default=[240, 2500, 5000, 10000])
    parser.add_argument("--work", type=Path, default=ROOT / "benchmarks" / "out" / "long_drive")
    parser.add_argument("--against", type=Path, help="another checkout, with its compiled core")
    parser.add_argument("--rounds", type=int, default=2, help="with --against: times that each of the two runs")
    parser.add_argument("--no-ids", action="store_true", help="leave track ids out")
    parser.add_argument("--truth", action="store_true", help="with the true cars, so that the runs can be scored")
    parser.add_argument("--record", action="store_true", help="write the figures to docs/results.json")
    a = parser.parse_args()
    a.work.mkdir(parents=True, exist_ok=True)
    one = street(a.work, *(["--no-ids"] if a.no_ids else []))
    kind = ("-no-ids" if a.no_ids else "") + ("-truth" if a.truth else "")
    checkouts = [ROOT] if a.against is None else [ROOT, a.against.resolve()] * a.rounds
    print(HEAD, flush=True)
    for frames in a.frames:
        drive = make(a.work / f"drive-{frames}{kind}", one, frames, truth=a.truth)
        runs: dict[Path, list[Taken]] = {}
        for checkout in checkouts:
            taken = run(checkout, drive, a.work / f"run-{frames}{kind}-{checkout.name}")
            runs.setdefault(checkout, []).append(taken)
            print(line("here" if checkout == ROOT else checkout.name, frames, taken), flush=True)
        if a.against is not None:
            _compare(runs[ROOT], runs[checkouts[1]])
        elif a.record:
            _record(frames, runs[ROOT][0])


def _compare(ours: list[Taken], theirs: list[Taken]) -> None:
    for what in ("seconds", "cpu_seconds", "peak_mb"):
        ratios = [getattr(one, what) / getattr(other, what) for one, other in zip(ours, theirs, strict=True)]
        print(f"{what}: {np.mean(ratios):.2f} of the other's ({', '.join(f'{r:.2f}' for r in ratios)})", flush=True)


def _record(frames: int, taken: Taken) -> None:
    figures = {
        "objects": taken.figures["objects_mapped"],
        "milliseconds_per_frame": 1e3 * taken.seconds / frames,
        "cpu_milliseconds_per_frame": 1e3 * taken.cpu_seconds / frames,
        "peak_memory_mb": taken.peak_mb,
    }
    record(f"map, a drive of {frames} frames", f"benchmarks/long_drive.py --frames {frames}", figures)


if __name__ == "__main__":
    main()
