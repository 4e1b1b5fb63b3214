import json

import numpy as np
import pytest

from meshslam.errors import SequenceError
from meshslam.geometry import Pose, exp_so3
from meshslam.sequences import read_extrinsics, read_imu
from meshslam.sequences.report import Report

MOUNTED = Pose(exp_so3(np.array([0.3, -1.2, 0.7])), np.array([0.1, -0.2, 0.3]))


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("bare.json", MOUNTED.matrix.tolist()),
        ("named.json", {"imu_from_camera": MOUNTED.matrix.tolist()}),
        ("inverse.json", {"camera_from_imu": MOUNTED.inverse().matrix.tolist()}),
        ("kalibr.yaml", {"cam0": {"T_cam_imu": MOUNTED.inverse().matrix.tolist(), "timeshift_cam_imu": 0.0}}),
    ],
)
def test_every_way_to_write_extrinsics(tmp_path, name, content):
    (tmp_path / name).write_text(json.dumps(content))
    pose, ahead_s = read_extrinsics(tmp_path / name)
    assert np.allclose(pose.matrix, MOUNTED.matrix)
    assert ahead_s == 0.0


def test_kalibrs_time_shift_and_camera_number(tmp_path):
    file = tmp_path / "camchain-imucam.yaml"
    rig = {"cam0": {"T_cam_imu": np.eye(4).tolist()}}
    rig["cam1"] = {"T_cam_imu": MOUNTED.inverse().matrix.tolist(), "timeshift_cam_imu": -0.012}
    file.write_text(json.dumps(rig))
    pose, ahead_s = read_extrinsics(file, 1)
    assert np.allclose(pose.matrix, MOUNTED.matrix)
    assert ahead_s == -0.012


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({}, "key"),
        ({"cam0": {}}, "T_cam_imu"),
        ([[1, 0], [0, 1]], "4x4"),
        ({"imu_from_camera": (2 * np.eye(4)).tolist()}, "orthonormal"),
        ({"cam0": {"T_cam_imu": np.eye(4).tolist(), "timeshift_cam_imu": [1, 2]}}, "one number"),
    ],
)
def test_wrong_extrinsics_are_named(tmp_path, content, said):
    (tmp_path / "rig.yaml").write_text(json.dumps(content) if content else "a: 1\n")
    with pytest.raises(SequenceError, match=said) as caught:
        read_extrinsics(tmp_path / "rig.yaml")
    assert "rig.yaml" in str(caught.value)


def test_imu_files(tmp_path):
    file = tmp_path / "imu.csv"
    file.write_text("timestamp,wx,wy,wz,ax,ay,az\n0.0,1,2,3,4,5,6\n0.01,1,2,3,4,5,6\n")
    samples = read_imu(file, Report())
    assert samples.rate_hz == pytest.approx(100)
    assert samples.specific_force_m_s2[0].tolist() == [4, 5, 6]
    file.write_text("timestamp,wx,wy,wz,ax,ay,az\n")
    with pytest.raises(SequenceError, match="no samples"):
        read_imu(file, Report())
