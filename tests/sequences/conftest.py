"""Small sequences on disk, whole and sound: tests break them one by one."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from meshslam.errors import SequenceError
from meshslam.geometry import Camera, Pose
from meshslam.sequences import ImuSamples, InitialState, check_sequence, open_sequence, write_sequence_folder

FRAMES = 5
CAMERA = Camera(64, 48, 60.0, 61.0, 31.5, 23.5)
DRIVE = "2011_09_26_drive_0001_sync"


def random_pose(rng) -> Pose:
    return Pose(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3))


def random_image(rng, shape=(48, 64, 3)):
    return rng.integers(0, 256, shape, dtype=np.uint8)


def coco_document(frames=FRAMES) -> dict:
    annotation = {
        "category_id": 1,
        "bbox": [2.0, 0.0, 2.0, 48.0],  # of the mask
        "score": 0.9,
        "segmentation": {"size": [48, 64], "counts": [100, 50, 48 * 64 - 150]},
        "keypoints": [5.0, 6.0, 2, 0, 0, 0],
        "keypoint_scores": [0.8, 0.0],
    }
    return {
        "images": [{"id": i, "file_name": f"{i:06d}.png", "width": 64, "height": 48} for i in range(frames)],
        "categories": [{"id": 1, "name": "car", "keypoints": ["front", "back"]}],
        "annotations": [{"id": i + 1, "image_id": i, **annotation} for i in range(frames)],
    }


@pytest.fixture
def folder(tmp_path: Path, rng) -> Path:
    """A sequence folder with everything in it."""
    times_s = np.arange(FRAMES) * 0.1
    imu_times_s = np.arange(-2, 45) * 0.01
    return write_sequence_folder(
        tmp_path / "drive",
        CAMERA,
        times_s,
        images=[random_image(rng) for _ in times_s],
        detections=coco_document(),
        world_from_camera=[random_pose(rng) for _ in times_s],
        imu=ImuSamples(imu_times_s, rng.normal(size=(47, 3)), rng.normal(size=(47, 3))),
        imu_from_camera=random_pose(rng),
        initial_state=InitialState(0.0, random_pose(rng), np.array([1.0, 2.0, 3.0])),
        height_above_ground_m=1.65,
    )


@pytest.fixture
def odometry(tmp_path: Path, rng) -> Path:
    """A KITTI odometry folder: 5 frames, 8 times, 8 poses."""
    path = tmp_path / "07"
    (path / "image_0").mkdir(parents=True)
    (path / "image_2").mkdir()
    (tmp_path / "poses").mkdir()
    for i in range(FRAMES):
        cv2.imwrite(str(path / "image_0" / f"{i:06d}.png"), random_image(rng, (48, 64)))
        cv2.imwrite(str(path / "image_2" / f"{i:06d}.png"), random_image(rng))
    projection = "60 0 31.5 {} 0 60 23.5 {} 0 0 1 {}"
    rows = [projection.format(0, 0, 0), projection.format(-30, 0, 0), projection.format(3.6, 0.012, 0.006)]
    (path / "calib.txt").write_text("".join(f"P{n}: {row}\n" for n, row in enumerate(rows)))
    (path / "times.txt").write_text("".join(f"{0.1 * i:e}\n" for i in range(8)))
    lines = []
    for i in range(8):
        rotation = Rotation.from_rotvec([0, 0.05 * i, 0]).as_matrix()
        lines.append(" ".join(f"{x:.9e}" for x in np.column_stack([rotation, [0.1 * i, 0, 1.0 * i]]).ravel()))
    (tmp_path / "poses" / "07.txt").write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture
def raw(tmp_path: Path, rng) -> Path:
    """A KITTI raw drive: straight north at 10 m/s, the images 10 ms before OXTS."""
    path = tmp_path / "2011_09_26" / DRIVE
    (path / "image_02" / "data").mkdir(parents=True)
    (path / "oxts" / "data").mkdir(parents=True)
    (path.parent / "calib_cam_to_cam.txt").write_text(
        "calib_time: 09-Jan-2012 13:57:47\n"
        "R_rect_00: 1 0 0 0 1 0 0 0 1\nS_rect_02: 64 48\nP_rect_02: 60 0 31.5 3.6 0 60 23.5 0 0 0 1 0\n"
    )
    (path.parent / "calib_velo_to_cam.txt").write_text("R: 0 -1 0 0 0 -1 1 0 0\nT: 0 -0.08 -0.27\n")
    (path.parent / "calib_imu_to_velo.txt").write_text("R: 1 0 0 0 1 0 0 0 1\nT: -0.81 0.32 -0.8\n")
    for i in range(FRAMES):
        cv2.imwrite(str(path / "image_02" / "data" / f"{i:010d}.png"), random_image(rng))
        latitude = 49.0 + np.degrees(1.0 * i / 6378137.0)
        row = (
            [latitude, 8.4, 115.0, 0.0, 0.0, np.pi / 2] + [0.0] * 5 + [0.1, 0.2, 9.81] + [0.0] * 3 + [0.01, 0.02, 0.03]
        )
        (path / "oxts" / "data" / f"{i:010d}.txt").write_text(" ".join(map(str, row + [0.0] * 10)) + "\n")
    write_stamps(path / "oxts" / "timestamps.txt", 0.010)
    write_stamps(path / "image_02" / "timestamps.txt", 0.0)
    return path


def write_stamps(file: Path, offset_s: float, count: int = FRAMES, step_s: float = 0.1) -> None:
    file.write_text("".join(f"2011-09-26 14:14:{10 + offset_s + step_s * i:012.9f}\n" for i in range(count)))


@pytest.fixture
def expect_problem():
    """Hold that loading raises one clear error, and that the check lists it too."""

    def hold(path: Path, message: str) -> None:
        with pytest.raises(SequenceError) as caught:
            open_sequence(path)
        assert message in str(caught.value)
        assert str(path.parent) in str(caught.value)
        assert any(message in str(problem) for problem in check_sequence(path)), check_sequence(path)

    return hold
