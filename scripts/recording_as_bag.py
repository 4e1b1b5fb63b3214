"""A recording that meshslam opens as a ROS 2 bag: `python -m scripts.recording_as_bag IN OUT [--repeat N]`.

Images raw, the camera's CameraInfo, odometry of a body where poses are known, its mounting in /tf_static, the IMU.
For measurements of bags against the layouts that the same data come in.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from meshslam.geometry import Pose
from meshslam.sequences import WORLD_FROM_FIRST_CAMERA, Sequence, open_sequence
from tests.sequences.bag_writing import BODY, IMAGE, IMU, IMU_FRAME, INFO, ODOMETRY, OPTICAL, START_NS, Ros, Said

CAMERA_FROM_BODY = Pose(WORLD_FROM_FIRST_CAMERA.rotation.T, np.array([0.1, 0.2, 0.3]))


def _ns(time_s: float) -> int:
    """Times from 0 on, as KITTI's, become dates: samples before the first frame would be negative."""
    return round(time_s * 1e9) + (START_NS if time_s < 1e8 else 0)


def said(ros: Ros, recording: Sequence, repeat: int) -> Iterator[Said]:
    """Message by message, the frames over and over."""
    body_from_camera = CAMERA_FROM_BODY.inverse()
    edges = [(BODY, OPTICAL, body_from_camera)]
    if recording.imu_from_camera is not None:
        edges.append((BODY, IMU_FRAME, body_from_camera @ recording.imu_from_camera.inverse()))
    if recording.height_above_ground_m is not None:
        lifted = np.array([0.0, 0.0, recording.height_above_ground_m - body_from_camera.translation[2]])
        edges.append(("base_footprint", BODY, Pose(np.eye(3), lifted)))
    yield Said("/tf_static", _ns(recording.times_s[0]), ros.transforms(0, edges))
    raw, bent = recording.raw_camera, recording.distortion
    period_s = float(np.median(np.diff(recording.times_s)))
    span_s = float(recording.times_s[-1] - recording.times_s[0]) + period_s
    for turn in range(repeat):
        for i, time_s in enumerate(recording.times_s):
            ns = _ns(time_s + turn * span_s)
            yield Said(INFO, ns, ros.info(ns, raw, () if bent is None else bent.coefficients))
            if recording.world_from_camera is not None:
                yield Said(ODOMETRY, ns, ros.odometry(ns, recording.world_from_camera[i] @ CAMERA_FROM_BODY))
            yield Said(IMAGE, ns, ros.image(ns, recording.images.read(i, None)))
    if recording.imu is not None:
        rows = zip(
            recording.imu.times_s, recording.imu.angular_rate_rad_s, recording.imu.specific_force_m_s2, strict=True
        )
        for time_s, rate, force in rows:
            ns = _ns(time_s)
            yield Said(IMU, ns, ros.imu(ns, rate, force))


def write(recording: Sequence, out: Path, repeat: int = 1, storage: str = "SQLITE3") -> None:
    """A bag folder, streamed."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    ros = Ros(2)
    with Writer(out, version=9, storage_plugin=StoragePlugin[storage]) as writer:
        connections = {}
        for s in said(ros, recording, repeat):
            if s.topic not in connections:
                connections[s.topic] = writer.add_connection(s.topic, s.kind, typestore=ros.types)
            writer.write(connections[s.topic], s.log_ns, ros.types.serialize_cdr(s.message, s.kind))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--repeat", type=int, default=1)
    parser.add_argument("--storage", default="SQLITE3", choices=["SQLITE3", "MCAP"])
    parser.add_argument("--imu", type=Path, help="CSV of a recording without one")
    parser.add_argument("--imu-from-camera", type=Path)
    given = parser.parse_args()
    recording = open_sequence(given.recording, imu=given.imu, imu_from_camera=given.imu_from_camera)
    write(recording, given.out, given.repeat, given.storage)


if __name__ == "__main__":
    main()
