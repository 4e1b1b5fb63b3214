"""nuScenes: a devkit's folder with v1.0-*/ tables, samples/ and sweeps/; one scene of it, by CAM_FRONT."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.errors import GeometryError, SequenceError
from meshslam.geometry import Camera, Pose
from meshslam.sequences.image_source import ImageFiles
from meshslam.sequences.loader import LoadOptions
from meshslam.sequences.report import Report, fail
from meshslam.sequences.sequence import ImuSamples, Sequence

CHANNELS = ("CAM_FRONT", "CAM_FRONT_LEFT", "CAM_FRONT_RIGHT", "CAM_BACK", "CAM_BACK_LEFT", "CAM_BACK_RIGHT")
_LARGEST_TABLE_BYTES = 2 << 30
Row = Mapping[str, Any]


@dataclass(frozen=True)
class NuScenes:
    """Poses are the ego vehicle's, world_from_ego of the map, z up; all frames, not key frames alone."""

    name: str = "nuscenes"
    looks_for: str = "a folder that holds v1.0-*/sample_data.json"
    accepts: frozenset[str] = frozenset({"scene"})

    def recognizes(self, path: Path) -> bool:
        """By its tables."""
        return any(path.glob("v1.0-*/sample_data.json"))

    def image_files(self, path: Path, options: LoadOptions) -> list[Path]:
        """Those of the scene; see Loader."""
        return [path / row["filename"] for row in _frames(path, options, Report())[1]]

    def load(self, path: Path, options: LoadOptions, report: Report) -> Sequence:
        """Read the tables; see Loader."""
        scene, rows = _frames(path, options, report)
        poses_by_token = _by_token(path, "ego_pose", {row["ego_pose_token"] for row in rows})
        mounted = _by_token(path, "calibrated_sensor", {rows[0]["calibrated_sensor_token"]})
        try:
            sensor = mounted[rows[0]["calibrated_sensor_token"]]
            ego_from_camera, camera = _pose(sensor), _camera(rows[0], sensor)
            bodies = [_pose(poses_by_token[row["ego_pose_token"]]) for row in rows]
        except (KeyError, TypeError, ValueError, GeometryError) as error:
            raise fail(
                path, scene["name"], f"the tables are damaged: {type(error).__name__} {str(error)[:80]}"
            ) from None
        imu = path / "can_bus" / f"{scene['name']}_ms_imu.json"
        has_imu = options.has_own_imu and imu.is_file()
        return Sequence(
            name=scene["name"],
            layout=self.name,
            root=path,
            camera=camera,
            frame_ids=tuple(range(len(rows))),
            times_s=np.array([row["timestamp"] for row in rows]) / 1e6,
            images=ImageFiles(tuple(path / row["filename"] for row in rows)),
            world_from_camera=tuple(b @ ego_from_camera for b in bodies) if options.has_own_poses else None,
            detections_path=options.detections_path,
            imu=_imu(imu) if has_imu else None,
            imu_from_camera=ego_from_camera,
            height_above_ground_m=float(ego_from_camera.translation[2]),
        )


def _table(path: Path, name: str) -> list[Row]:
    """A table's rows; FoundError if it is missing or no table."""
    folders = sorted(path.glob("v1.0-*"))
    file = folders[0] / f"{name}.json" if folders else path / f"{name}.json"
    try:
        if file.stat().st_size > _LARGEST_TABLE_BYTES:
            raise fail(file, "", f"is larger than {_LARGEST_TABLE_BYTES >> 30} GB: not read")
        rows = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise fail(file, "", f"cannot be read as a table: {' '.join(str(error).split())[:100]}") from None
    if not isinstance(rows, list) or not all(isinstance(row, dict) and "token" in row for row in rows):
        raise fail(file, "", "expected a list of rows with a token each")
    return rows


def _by_token(path: Path, name: str, wanted: set[str]) -> dict[str, Row]:
    return {row["token"]: row for row in _table(path, name) if row["token"] in wanted}


def _frames(path: Path, options: LoadOptions, report: Report) -> tuple[Row, list[Row]]:
    """The scene, and its rows of sample_data of the camera, by time."""
    scene = _scene(path, options.scene)
    number = options.camera_number or 0
    if number >= len(CHANNELS):
        raise SequenceError(f"{path}: nuScenes has the cameras 0 to {len(CHANNELS) - 1}, not {number}")
    try:
        samples = {row["token"] for row in _table(path, "sample") if row["scene_token"] == scene["token"]}
        sensors = {row["token"] for row in _table(path, "sensor") if row["channel"] == CHANNELS[number]}
        mounted = {row["token"] for row in _table(path, "calibrated_sensor") if row["sensor_token"] in sensors}
        data = _table(path, "sample_data")
        rows = [r for r in data if r["sample_token"] in samples and r["calibrated_sensor_token"] in mounted]
        rows.sort(key=lambda row: int(row["timestamp"]))
        there = [row for row in rows if (path / row["filename"]).is_file()]
    except (KeyError, TypeError, ValueError) as error:
        raise fail(path, scene["name"], _damaged(error)) from None
    if not there:
        raise fail(path, scene["name"], f"none of the {len(rows)} images of {CHANNELS[number]} is there")
    if len(there) < len(rows):
        report.note(path, scene["name"], f"{len(rows) - len(there)} of {len(rows)} images are not there and left out")
    return scene, there


def _scene(path: Path, name: str | None) -> Row:
    scenes = {str(row.get("name")): row for row in _table(path, "scene")}
    names = ", ".join(sorted(scenes)[:6]) + (" …" if len(scenes) > 6 else "")
    if name is None and len(scenes) == 1:
        return next(iter(scenes.values()))
    if name is None:
        raise SequenceError(f"{path}: holds {len(scenes)} scenes: choose one by --scene NAME: {names}")
    if name not in scenes:
        raise SequenceError(f"{path}: has no scene {name[:40]!r}; there are {names}")
    return scenes[name]


def _damaged(error: Exception) -> str:
    return f"the tables are damaged: {type(error).__name__} {str(error)[:80]}"


def _pose(row: Row) -> Pose:
    return Pose.from_quaternion(np.asarray(row["rotation"], float), np.asarray(row["translation"], float), order="wxyz")


def _camera(row: Row, sensor: Row) -> Camera:
    matrix = np.asarray(sensor["camera_intrinsic"], float).reshape(3, 3)
    fx, fy, cx, cy = (float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return Camera(int(row["width"]), int(row["height"]), fx, fy, cx, cy, float(matrix[0, 1]))


def _imu(path: Path) -> ImuSamples:
    """Of the CAN bus: the ego frame's axes, gravity included."""
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))
        table = np.array([[r["utime"], *r["rotation_rate"], *r["linear_accel"]] for r in rows], float).reshape(-1, 7)
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise fail(path, "", f"cannot be read: {type(error).__name__} {' '.join(str(error).split())[:80]}") from None
    times_s, first = np.unique(table[:, 0] / 1e6, return_index=True)
    if not len(times_s) or not np.isfinite(table).all():
        raise fail(path, "", "holds no samples, or what is no number")
    return ImuSamples(times_s, table[first, 1:4], table[first, 4:7])
