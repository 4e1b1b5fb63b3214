"""Streets in which cars drive, with the truth of their paths, for benchmarks/movers.py.

Of KITTI: a car model is drawn at each labelled pose of a car that drives, and parked ones beside it, along KITTI's
camera path. Drawn: streets of the package's own simulation, with cars ahead, oncoming, and turning off.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from localize import DATA, tum
from street_passes import case_tool

from meshslam.geometry import Pose
from meshslam.maps import MovingPath, PlyMesh, format_ply
from meshslam.perception import write_detections
from meshslam.sequences import write_sequence_folder
from meshslam.simulation import ObserverConfig, SimulationConfig, StreetConfig, make_world, observe, write_truth

NEAR_M, FEWEST = 45.0, 8
PARKED_M, DRIVES_M = 1.0, 3.0  # how far a label goes
RATE_HZ = 10.0


def drawn_street(out: Path, seed: int, frames: int) -> None:
    """A bending street with two cars ahead, two oncoming ones and one that turns off; without images."""
    street = StreetConfig(
        frames=frames, moving_cars=4, turning_cars=1, bend_deg=10.0, spread=True, cars_each_side=5, width_px=1242
    )
    world = make_world(SimulationConfig(seed=seed, street=street))
    shutil.rmtree(out, ignore_errors=True)
    found, truth = observe(world, ObserverConfig())
    write_sequence_folder(
        out,
        world.camera,
        world.times_s,
        detections=json.loads(write_detections(found)),
        world_from_camera=world.world_from_camera,
        height_above_ground_m=world.camera_height_m,
    )
    write_truth(world, truth, out)


def labelled_street(out: Path, sequence: str, start: int, frames: int, seed: int) -> None:
    """Cars of a tracking sequence's labels, parked and driving, as the case tool draws and spoils them."""
    tool, of = case_tool(), DATA / "kitti_tracking" / sequence
    models = tool.load_cars(DATA / "cars")

    def write(_a: Any, k: Any, times: Any, poses: Any, parked: Any, noise: Any, **_rest: Any) -> None:
        driving = driving_cars(tool, models, of, poses, start)
        taken = {one["id"] for one in driving}
        parked = [one for one in parked if one["id"] not in taken]
        _write(tool, out, k, times, poses, parked, driving, noise)

    tool.write_case = write
    a = SimpleNamespace(
        out=out,
        kind="street",
        poses=str(of / "poses.txt"),
        labels=str(of / "label_02.txt"),
        intrinsics=str(of / "camera.yaml"),
        start=start,
        frames=frames,
        clean=False,
        ids=False,
        noise=np.random.default_rng([seed, start]),
    )
    tool.street(a, models, np.random.default_rng(seed))


def driving_cars(tool: Any, models: Any, folder: Path, poses: Any, start: int) -> list[dict[str, Any]]:
    """Labelled cars that drive: a model of like size, and its pose by frame of the window."""
    rows: dict[int, list[tuple[int, np.ndarray, np.ndarray]]] = {}
    for line in (folder / "label_02.txt").read_text().splitlines():
        words = line.split()
        frame, number = int(words[0]) - start, int(words[1])
        if words[2] in ("Car", "Van") and 0 <= frame < len(poses):
            h, w, length, x, y, z, ry = map(float, words[10:17])
            local, (c, s) = np.eye(4), (np.cos(ry), np.sin(ry))
            local[:3, 3] = x, y - h / 2, z
            local[:3, :3] = np.array([[c, s, 0], [0, 0, -1], [-s, c, 0]])  # x forward, y left, z up
            if np.hypot(x, z) < NEAR_M:
                rows.setdefault(number, []).append((frame, poses[frame] @ local, np.array([length, w, h])))
    cars = []
    for number, seen in sorted(rows.items()):
        centres = np.array([pose[:3, 3] for _, pose, _ in seen])
        if len(seen) >= FEWEST and np.linalg.norm(centres - np.median(centres, 0), axis=1).max() > DRIVES_M:
            size = np.median([size for _, _, size in seen], axis=0)
            name = min(models, key=lambda n: float(np.abs(np.ptp(models[n][0], 0) - size).sum()))
            scale = np.clip(size / np.ptp(models[name][0], 0), 0.85, 1.15)
            car = tool.make_object(number, name, models[name], seen[0][1], scale)
            cars.append(car | {"poses": {frame: pose for frame, pose, _ in seen}})
    return cars


def _write(tool: Any, out: Path, k: Any, times: Any, poses: Any, parked: Any, driving: Any, rng: Any) -> None:
    shutil.rmtree(out, ignore_errors=True)
    annotations: list[dict[str, Any]] = []
    for frame, pose in enumerate(poses):
        there = [one | {"pose": one["poses"][frame]} for one in driving if frame in one["poses"]]
        for found in tool.observe(k, pose, [*parked, *there], frame, rng, clean=False):
            annotations.append(found | {"id": len(annotations) + 1})
    association = {found["id"]: found.pop("track_id") for found in annotations}
    (out / "meshes").mkdir(parents=True)
    (out / "moving").mkdir()
    camera = {"model": "pinhole", "resolution": [tool.WIDTH, tool.HEIGHT], "intrinsics": [float(x) for x in k]}
    (out / "camera.yaml").write_text(json.dumps(camera | {"height_above_ground_m": 1.65}))
    (out / "times.txt").write_text("".join(f"{t:.9f}\n" for t in times))
    (out / "poses.tum").write_text(tum(times, poses))
    images = [
        {"id": i, "file_name": f"{i:06d}.png", "width": tool.WIDTH, "height": tool.HEIGHT} for i in range(len(poses))
    ]
    categories = [{"id": 1, "name": "car", "keypoints": tool.NAMES}]
    document = {"images": images, "categories": categories, "annotations": annotations}
    (out / "detections.json").write_text(json.dumps(document))
    (out / "association.json").write_text(json.dumps(association))
    (out / "objects.json").write_text(json.dumps({"objects": [_entry(one, out) for one in parked]}))
    moving = []
    for one in driving:
        path = _path(one["poses"], np.asarray(times))
        (out / f"moving/{one['id']}.csv").write_bytes(path.to_csv())
        moving.append(
            _entry(one, out) | {"moving": True, "timestamp": path.times_s[0], "path": f"moving/{one['id']}.csv"}
        )
    (out / "moving.json").write_text(json.dumps({"objects": [], "moving": moving}))


def _entry(one: dict[str, Any], out: Path) -> dict[str, Any]:
    mesh = f"meshes/{one['id']}.ply"
    (out / mesh).write_bytes(format_ply(PlyMesh(one["vertices"], one["faces"])))
    return {"id": one["id"], "category": "car", "world_from_object": one["pose"].tolist(), "mesh": mesh}


def _path(poses: dict[int, np.ndarray], times: np.ndarray) -> MovingPath:
    """The labels' poses; velocity and turn rate by parabolas through half a second around each."""
    from scipy.signal import savgol_filter

    frames = sorted(poses)
    placed = tuple(Pose.from_matrix(poses[frame]) for frame in frames)
    centres, at = np.array([pose.translation for pose in placed]), times[frames]
    yaw = np.unwrap([pose.yaw_rad for pose in placed])
    even = np.arange(frames[0], frames[-1] + 1)
    filled = np.column_stack([np.interp(even, frames, column) for column in (*centres.T, yaw)])
    window = min(7, 2 * ((len(even) - 1) // 2) + 1)
    rates = savgol_filter(filled, window, 2, deriv=1, delta=1 / RATE_HZ, axis=0)[np.array(frames) - frames[0]]
    nothing, ahead = np.zeros(len(frames)), np.array([pose.rotation[:, 0] for pose in placed])
    speeds = (rates[:, :3] * ahead).sum(1)
    covariances = np.zeros((len(frames), 6, 6))
    return MovingPath(at, tuple(frames), placed, covariances, rates[:, :3], speeds, nothing, rates[:, 3], nothing)
