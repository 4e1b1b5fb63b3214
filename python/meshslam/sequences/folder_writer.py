"""Writes sequence folders as docs/formats.md has them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from collections.abc import Sequence as Items
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from meshslam.errors import SequenceError
from meshslam.files import write_into
from meshslam.geometry import Bytes, Camera, Floats, Pose
from meshslam.sequences.distortion import Distortion
from meshslam.sequences.imu_files import IMU_COLUMNS
from meshslam.sequences.sequence import ImuSamples, InitialState
from meshslam.sequences.tum import format_tum


def write_sequence_folder(
    folder: Path,
    camera: Camera,
    times_s: Floats,
    *,
    images: Iterable[Bytes] | None = None,
    detections: Mapping[str, Any] | None = None,
    world_from_camera: Items[Pose] | None = None,
    partial_poses: Mapping[int, Pose] | None = None,
    frame_ids: Items[int] | None = None,
    imu: ImuSamples | None = None,
    imu_from_camera: Pose | None = None,
    initial_state: InitialState | None = None,
    height_above_ground_m: float | None = None,
    distortion: Distortion | None = None,
) -> Path:
    """Write one sequence: times (n,) in seconds, images BGR (h, w, 3) or grey (h, w), detections as a COCO document.

    With a distortion, images and detections are those of its raw camera. `partial_poses` by index are written where not
    every frame has one; `frame_ids` are the images' numbers, else they are counted from 0. Images are asked for one by
    one. SequenceError if the folder cannot be written.
    """
    raw = camera if distortion is None else distortion.raw_camera
    files = {
        "camera.yaml": camera_yaml(raw, distortion, imu_from_camera, height_above_ground_m),
        "times.txt": "".join(f"{t:.9f}\n" for t in times_s),
        "poses.tum": _poses_tum(times_s, dict(enumerate(world_from_camera or ())) or partial_poses),
        "imu.csv": None if imu is None else _imu_csv(imu),
        "initial_state.yaml": None if initial_state is None else _initial_state_yaml(initial_state),
        "detections.json": None if detections is None else json.dumps(detections),
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            if text is not None:
                write_into(folder / name, text, SequenceError)
        for i, image in enumerate(images or []):
            _write_png(folder / "images" / f"{i if frame_ids is None else frame_ids[i]:06d}.png", image)
    except OSError as error:
        raise SequenceError(f"{folder}: cannot be written: {error.strerror}") from None
    return folder


def camera_yaml(
    camera: Camera,
    distortion: Distortion | None = None,
    imu_from_camera: Pose | None = None,
    height_above_ground_m: float | None = None,
) -> str:
    """Format a camera.yaml; `camera` is the raw one where there is distortion."""
    content: dict[str, Any] = {
        "model": "pinhole",
        "resolution": [camera.width, camera.height],
        "intrinsics": [float(x) for x in (camera.fx, camera.fy, camera.cx, camera.cy)],
        "skew": float(camera.skew),
        "distortion_model": "none" if distortion is None else distortion.model,
        "distortion_coeffs": [] if distortion is None else distortion.coefficients.tolist(),
    }
    if imu_from_camera is not None:
        content["imu_from_camera"] = _matrix(imu_from_camera)
    if height_above_ground_m is not None:
        content["height_above_ground_m"] = float(height_above_ground_m)
    return _dump(content)


def _poses_tum(times_s: Floats, poses: Mapping[int, Pose] | None) -> str | None:
    if not poses:
        return None
    kept = sorted(poses)
    return format_tum(np.asarray(times_s)[kept], [poses[i] for i in kept])


def _matrix(pose: Pose) -> list[list[float]]:
    rows: list[list[float]] = (pose.matrix + 0.0).tolist()  # no -0.0; all digits, so that a copy is the same
    return rows


def _dump(content: dict[str, Any]) -> str:
    return str(yaml.safe_dump(content, default_flow_style=None, sort_keys=False))


def _imu_csv(imu: ImuSamples) -> str:
    rows = np.column_stack([imu.times_s, imu.angular_rate_rad_s, imu.specific_force_m_s2])
    lines = [",".join(IMU_COLUMNS)] + [",".join(map(repr, row)) for row in rows.tolist()]
    return "\n".join(lines) + "\n"


def _initial_state_yaml(state: InitialState) -> str:
    return _dump(
        {
            "timestamp": float(state.time_s),
            "world_from_camera": _matrix(state.world_from_camera),
            "velocity_in_world": [float(x) for x in state.velocity_in_world],
        }
    )


def _write_png(path: Path, image: Bytes) -> None:
    path.parent.mkdir(exist_ok=True)
    done, code = cv2.imencode(".png", image)
    if not done:
        raise SequenceError(f"{path}: an image of shape {image.shape} cannot be written as PNG")
    write_into(path, code.tobytes(), SequenceError)
