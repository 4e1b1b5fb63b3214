"""Whether an IMU is mounted as its extrinsics say."""

from __future__ import annotations

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.plausibility.finding import Finding
from meshslam.sequences import ImuSamples, Sequence

_UPRIGHT_DEG = 30.0  # between the specific force and up: braking at 0.5 g makes 27
_AWAY_DEG = 60.0  # in the camera, where no pose is known: cameras on vehicles and robots look about level
_UP_IN_IMAGE = np.array([0.0, -1.0, 0.0])
_ADVICE = "check imu_from_camera, the world's z axis (up), and the accelerometer's axes"
_MEAN_S = 1.0  # over which the force is averaged


def judge_mounting(sequence: Sequence, imu: ImuSamples, imu_from_camera: Pose, source: str) -> list[Finding]:
    """The specific force must point up in the world of the start or of the known poses.

    Without either, it must point up in the image, roughly: that is a note only.
    """
    force = _mean_force(imu, float(sequence.times_s[0]))
    if force is None:
        return []
    start = sequence.initial_state
    if start is not None:
        return _in_world(force, start.world_from_camera, imu_from_camera, source, "initial_state.yaml")
    if sequence.world_from_camera is not None and sequence.is_levelled:
        return _in_world(force, sequence.world_from_camera[0], imu_from_camera, source, "the first known pose")
    up_in_camera = imu_from_camera.rotation.T @ force
    angle = _angle_deg(up_in_camera, _UP_IN_IMAGE)
    if angle <= _AWAY_DEG:
        return []
    mistake = _mistake(imu_from_camera, force, _UP_IN_IMAGE)
    message = f"{source}: by imu_from_camera the specific force points {angle:.0f}° away from the image's up"
    return [
        Finding("mounting", f"{message}: {mistake or _ADVICE}", "error" if mistake else "note", {"angle_deg": angle})
    ]


def _in_world(force: Floats, world_from_camera: Pose, imu_from_camera: Pose, source: str, known: str) -> list[Finding]:
    camera_from_world = world_from_camera.rotation.T
    up_in_camera = camera_from_world @ np.array([0.0, 0.0, 1.0])
    angle = _angle_deg(imu_from_camera.rotation.T @ force, up_in_camera)
    if angle <= _UPRIGHT_DEG:
        return []
    advice = _mistake(imu_from_camera, force, up_in_camera) or _ADVICE
    message = f"{source}: by imu_from_camera and {known} the specific force points {angle:.0f}° away from up: {advice}"
    return [Finding("mounting", message, figures={"angle_deg": angle})]


def _mistake(imu_from_camera: Pose, force: Floats, up_in_camera: Floats) -> str | None:
    """The usual mistake that explains where the force points, if there is one."""
    rotation = imu_from_camera.rotation
    fits = [
        ("it is camera_from_imu (Kalibr's T_cam_imu): invert it, or call the key camera_from_imu", rotation @ force),
        ("the accelerometer's sign is turned: at rest it must read +9.8 upwards", -rotation.T @ force),
    ]
    for said, up in fits:
        if _angle_deg(up, up_in_camera) < 0.5 * _UPRIGHT_DEG:
            return said
    if np.allclose(rotation, np.eye(3), atol=1e-6):
        return "imu_from_camera is the identity: give how the camera is mounted (x right, y down, z forward)"
    return None


def _mean_force(imu: ImuSamples, start_s: float) -> Floats | None:
    inside = (imu.times_s >= start_s - 0.5 * _MEAN_S) & (imu.times_s <= start_s + 0.5 * _MEAN_S)
    if inside.sum() < 3:
        return None
    mean: Floats = imu.specific_force_m_s2[inside].mean(0)
    return mean if float(np.linalg.norm(mean)) > 1e-6 else None


def _angle_deg(one: Floats, other: Floats) -> float:
    cosine = float(one @ other) / float(np.linalg.norm(one) * np.linalg.norm(other))
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
