"""nuScenes: a devkit's folder with v1.0-*/ tables, samples/ and sweeps/; one scene of it, by CAM_FRONT."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

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
Made = TypeVar("Made")


@dataclass(frozen=True)
class NuScenes:
    """Poses are the ego vehicle's, world_from_ego of the map, z up; all frames, not key frames alone."""

    name: str = "nuscenes"
    looks_for: str = "a folder that holds v1.0-*/sample_data.json"
    accepts: frozenset[str] = frozenset({"scene"})

    def recognizes(self, path: Path) -> bool:
        """By its tables."""
        return any(path.glob("v1.0-*/sample_data.json")) or (path / "sample_data.json").is_file()

    def image_files(self, path: Path, options: LoadOptions) -> list[Path]:
        """Those of the scene; see Loader."""
        tables, scene = _scene(path, options.scene)
        return [path / row["filename"] for row in _frames(path, tables, scene, options, Report())]

    def load(self, path: Path, options: LoadOptions, report: Report) -> Sequence:
        """Read the tables; see Loader."""
        tables, scene = _scene(path, options.scene)
        rows = _frames(path, tables, scene, options, report)
        mounted = tables.rows("calibrated_sensor", {row["calibrated_sensor_token"] for row in rows})
        sensor = mounted[rows[0]["calibrated_sensor_token"]]
        ego_from_camera, camera = tables.made("calibrated_sensor", sensor, _pose), _camera(tables, rows[0], sensor)
        bodies = None
        if options.has_own_poses:
            poses = tables.rows("ego_pose", {row["ego_pose_token"] for row in rows})
            bodies = [tables.made("ego_pose", poses[row["ego_pose_token"]], _pose) for row in rows]
        imu = path / "can_bus" / f"{scene['name']}_ms_imu.json"
        has_imu = options.has_own_imu and imu.is_file()
        return Sequence(
            name=str(scene["name"]),
            layout=self.name,
            root=path,
            camera=camera,
            frame_ids=tuple(range(len(rows))),
            times_s=np.array([row["timestamp"] for row in rows]) / 1e6,
            images=ImageFiles(tuple(path / row["filename"] for row in rows)),
            world_from_camera=None if bodies is None else tuple(b @ ego_from_camera for b in bodies),
            detections_path=options.detections_path,
            imu=_imu(imu) if has_imu else None,
            imu_from_camera=ego_from_camera,
            height_above_ground_m=float(ego_from_camera.translation[2]),
        )


@dataclass(frozen=True)
class _Tables:
    """One of a data set's folders of tables, such as v1.0-mini."""

    folder: Path

    def read(self, name: str, keys: Mapping[str, type | tuple[type, ...]]) -> list[Row]:
        """A table's rows; FoundError if it is missing, no table, or a row lacks one of `keys` or has another type."""
        file = self.folder / f"{name}.json"
        try:
            if file.stat().st_size > _LARGEST_TABLE_BYTES:
                raise fail(file, "", f"is larger than {_LARGEST_TABLE_BYTES >> 30} GB: not read")
            rows = json.loads(file.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise fail(file, "", "no such table: unpack the meta data of the data set again") from None
        except (OSError, ValueError, RecursionError) as error:
            said = " ".join(str(error).split())[:100]
            raise fail(file, "", f"cannot be read as a table, it is cut or damaged: {said}") from None
        if not isinstance(rows, list):
            raise fail(file, "", "expected a list of rows")
        for number, row in enumerate(rows):
            for key, kind in {"token": str, **keys}.items():
                if not isinstance(row, dict) or not isinstance(row.get(key), kind) or isinstance(row[key], bool):
                    found = repr(row.get(key))[:40] if isinstance(row, dict) else repr(row)[:40]
                    raise fail(file, f"row {number}", f"{key}: found {found}: the table is damaged, unpack it again")
        return rows

    def rows(self, name: str, wanted: set[str]) -> dict[str, Row]:
        """Those rows of a table by their tokens; FoundError if one is not there."""
        found = {row["token"]: row for row in self.read(name, {}) if row["token"] in wanted}
        for token in sorted(wanted - found.keys())[:1]:
            missing = len(wanted - found.keys())
            said = f"{missing} rows that sample_data.json names are not there, such as {token[:40]}"
            raise fail(self.folder / f"{name}.json", "", f"{said}: are the tables of one data set?")
        return found

    def made(self, name: str, row: Row, make: Callable[[Row], Made]) -> Made:
        """What a row holds; FoundError names it where it holds something else."""
        try:
            return make(row)
        except (KeyError, TypeError, ValueError, OverflowError, GeometryError) as error:
            said = f"{type(error).__name__}: {' '.join(str(error).split())[:80]}"
            raise fail(self.folder / f"{name}.json", f"token {str(row['token'])[:40]}", f"is damaged: {said}") from None


def _scene(path: Path, name: str | None) -> tuple[_Tables, Row]:
    """The scene, and the tables that hold it."""
    if (path / "sample_data.json").is_file():
        raise fail(path, "", f"holds the tables alone: give the folder above it, {path.resolve().parent}")
    folders = [file.parent for file in sorted(path.glob("v1.0-*/sample_data.json"))]
    if not folders:
        raise fail(
            path, "", "holds no tables, v1.0-*/sample_data.json: give nuScenes' folder that holds them and samples/"
        )
    scenes = {str(row["name"]): (t, row) for t in map(_Tables, folders) for row in t.read("scene", {"name": str})}
    names = ", ".join(sorted(scenes)[:6]) + (" …" if len(scenes) > 6 else "")
    if not scenes:
        raise fail(folders[0] / "scene.json", "", "holds no scenes")
    if name is None and len(scenes) == 1:
        return next(iter(scenes.values()))
    if name is None:
        raise SequenceError(f"{path}: holds {len(scenes)} scenes: choose one by --scene NAME: {names}")
    if name not in scenes:
        raise SequenceError(f"{path}: has no scene {name[:40]!r}; there are {names}")
    return scenes[name]


def _frames(path: Path, tables: _Tables, scene: Row, options: LoadOptions, report: Report) -> list[Row]:
    """The scene's rows of sample_data of the camera whose images are there, by time."""
    number = options.camera_number or 0
    if number >= len(CHANNELS):
        named = ", ".join(f"{i} {name}" for i, name in enumerate(CHANNELS))
        raise SequenceError(f"{path}: nuScenes has no camera {number}, only {named}: choose one by --camera N")
    samples = {r["token"] for r in tables.read("sample", {"scene_token": str}) if r["scene_token"] == scene["token"]}
    sensors = {r["token"] for r in tables.read("sensor", {"channel": str}) if r["channel"] == CHANNELS[number]}
    calibrated = tables.read("calibrated_sensor", {"sensor_token": str})
    mounted = {r["token"] for r in calibrated if r["sensor_token"] in sensors}
    rows = [
        row
        for row in tables.read("sample_data", {"sample_token": str, "calibrated_sensor_token": str})
        if row["sample_token"] in samples and row["calibrated_sensor_token"] in mounted
    ]
    file = tables.folder / "sample_data.json"
    for row in rows:
        for key, kind in {"timestamp": int, "filename": str, "ego_pose_token": str}.items():
            outside = key == "filename" and (Path(str(row.get(key))).is_absolute() or ".." in str(row.get(key)))
            if not isinstance(row.get(key), kind) or outside:
                raise fail(
                    file, f"token {row['token'][:40]}", f"{key}: found {str(row.get(key))[:40]!r}: it is damaged"
                )
    if not rows:
        raise fail(file, str(scene["name"]), f"has no frame of {CHANNELS[number]}: are the tables of one data set?")
    rows.sort(key=lambda row: int(row["timestamp"]))
    there = [row for row in rows if (path / row["filename"]).is_file()]
    if not there:
        said = f"none of the {len(rows)} images of {CHANNELS[number]} is there, such as {rows[0]['filename'][-80:]}"
        raise fail(path, str(scene["name"]), f"{said}: unpack samples and sweeps here")
    if len(there) < len(rows):
        missing = len(rows) - len(there)
        report.note(path, str(scene["name"]), f"{missing} of {len(rows)} images are not there and left out")
    for one, other in pairwise(there):
        if one["timestamp"] == other["timestamp"]:
            raise fail(file, f"token {other['token'][:40]}", f"a second image of the time {one['timestamp']}")
    return there


def _pose(row: Row) -> Pose:
    rotation, translation = (np.asarray(row[key], float) for key in ("rotation", "translation"))
    return Pose.from_quaternion(rotation.reshape(4), translation.reshape(3), order="wxyz")


def _camera(tables: _Tables, frame: Row, sensor: Row) -> Camera:
    def made(row: Row) -> Camera:
        matrix = np.asarray(row["camera_intrinsic"], float).reshape(3, 3)
        fx, fy, cx, cy = (float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
        return Camera(int(frame["width"]), int(frame["height"]), fx, fy, cx, cy, float(matrix[0, 1]))

    return tables.made("calibrated_sensor", sensor, made)


def _imu(path: Path) -> ImuSamples:
    """Of the CAN bus: the ego frame's axes, gravity included."""
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))
        table = np.array([[r["utime"], *r["rotation_rate"], *r["linear_accel"]] for r in rows], float).reshape(-1, 7)
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        said = f"{type(error).__name__} {' '.join(str(error).split())[:80]}"
        raise fail(path, "", f"is cut or damaged: {said}: unpack the CAN bus data again, or move it away") from None
    times_s, first = np.unique(table[:, 0] / 1e6, return_index=True)
    if not len(times_s) or not np.isfinite(table).all():
        raise fail(path, "", "holds no samples, or what is no number")
    return ImuSamples(times_s, table[first, 1:4], table[first, 4:7])
