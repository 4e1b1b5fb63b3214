import numpy as np
import pytest

from meshslam.sequences import ImuSamples, check_sequence, write_sequence_folder
from tests.sequences.conftest import CAMERA, FRAMES, coco_document


def test_all_problems_of_all_files_are_listed(folder):
    (folder / "camera.yaml").write_text("model: fisheye\nresolution: [64, 48]\n")
    (folder / "times.txt").write_text("0\nnan\n0.3\n0.2\n0.4\n")
    (folder / "poses.tum").write_text("".join(f"{0.1 * i} 0 0 0 0 0 0 {1 + (i == 1)}\n" for i in range(5)))
    (folder / "imu.csv").write_text("timestamp,wx,wy,wz,ax,ay,az\n0,0,0,0,0,0\n")
    (folder / "images" / "000002.png").write_bytes(b"")
    found = [(p.file.name, p.where) for p in check_sequence(folder)]
    assert sorted(found) == [
        ("000002.png", ""),
        ("camera.yaml", "intrinsics"),
        ("camera.yaml", "model"),
        ("imu.csv", ""),
        ("imu.csv", "line 2"),
        ("poses.tum", "line 2"),
        ("times.txt", "line 2"),
        ("times.txt", "line 4"),
    ]


def imu_folder(tmp_path, times_s, poses=None):
    count = len(times_s)
    return write_sequence_folder(
        tmp_path / "s",
        CAMERA,
        np.arange(FRAMES) * 0.1,
        detections=coco_document(),
        imu=ImuSamples(times_s, np.zeros((count, 3)), np.zeros((count, 3))),
        imu_from_camera=poses,
    )


@pytest.mark.parametrize(
    ("times_s", "where", "what"),
    [
        (np.arange(-1, 6) * 0.1, "rate", "10.0 Hz, at least 50 Hz"),
        (np.arange(0, 20) * 0.01, "overlap", "do not cover the frames from 0.000 s to 0.400 s"),
        (np.r_[np.arange(0, 10) * 0.01, np.arange(20, 50) * 0.01], "rate", "no samples between 0.090 s and 0.200 s"),
    ],
)
def test_imu_rate_overlap_and_gaps_are_looked_at(tmp_path, times_s, where, what):
    from meshslam.geometry import Pose

    found = check_sequence(imu_folder(tmp_path, times_s, Pose.identity()))
    assert [p.where for p in found] == [where]
    assert what in found[0].what


def test_an_unknown_key_is_noted(folder):
    with (folder / "camera.yaml").open("a") as file:
        file.write("distortion_coefs: [1, 2, 3, 4]\n")
    assert [(p.where, p.severity) for p in check_sequence(folder)] == [("distortion_coefs", "problem")]
