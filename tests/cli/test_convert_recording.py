"""`convert recording`: any recording becomes a sequence folder that opens as the same."""

import numpy as np
import pytest

from meshslam.sequences import Distortion, open_sequence, write_sequence_folder
from tests.cli.conftest import done, error_of, meshslam
from tests.sequences.conftest import CAMERA, FRAMES, folder, random_image, random_pose, raw  # noqa: F401 # fixtures


def expect_same(found, expected):
    assert found.frame_ids == expected.frame_ids
    np.testing.assert_allclose(found.times_s, expected.times_s, atol=1e-9)
    for i in range(len(expected)):
        np.testing.assert_array_equal(found.read_image(i), expected.read_image(i))
    poses = ([p.matrix for p in s.world_from_camera] for s in (found, expected))
    np.testing.assert_allclose(*poses, atol=1e-6)
    assert found.camera == expected.camera
    assert found.height_above_ground_m == expected.height_above_ground_m


def test_a_folder_is_its_own_copy(folder, tmp_path):  # noqa: F811
    said = done("convert", "recording", folder, tmp_path / "copy")
    assert "5 frames, 5 poses, 47 IMU samples" in said.stdout
    assert "detections are not copied" in said.stderr
    copy, own = open_sequence(tmp_path / "copy"), open_sequence(folder)
    expect_same(copy, own)
    np.testing.assert_allclose(copy.imu.angular_rate_rad_s, own.imu.angular_rate_rad_s)
    np.testing.assert_allclose(copy.imu_from_camera.matrix, own.imu_from_camera.matrix, atol=1e-8)


def test_a_part_of_another_layout_keeps_its_frames_numbers(raw, tmp_path):  # noqa: F811
    done("convert", "recording", raw, "--out", tmp_path / "copy", "--frames", "1:5:2")
    expect_same(open_sequence(tmp_path / "copy"), open_sequence(raw, frames="1:5:2"))
    assert sorted(p.name for p in (tmp_path / "copy" / "images").iterdir()) == ["000001.png", "000003.png"]


def test_distortion_and_missing_poses_are_kept(tmp_path, rng):
    images, poses = [random_image(rng) for _ in range(FRAMES)], {1: random_pose(rng), 3: random_pose(rng)}
    own = write_sequence_folder(
        tmp_path / "own",
        CAMERA,
        np.arange(FRAMES) * 1.0,
        images=images,
        partial_poses=poses,
        distortion=Distortion(CAMERA, CAMERA, np.array([-0.2, 0.05, 0.0, 0.0])),
    )
    done("convert", "recording", own, tmp_path / "copy")
    copy = open_sequence(tmp_path / "copy")
    assert sorted(copy.partial_poses) == [1, 3]
    np.testing.assert_array_equal(copy.distortion.coefficients, [-0.2, 0.05, 0, 0])
    np.testing.assert_array_equal(copy.images.read(2, None), images[2])


def test_what_is_there_is_replaced_only_where_that_is_said(folder, tmp_path):  # noqa: F811
    copy = tmp_path / "copy"
    done("convert", "recording", folder, copy)
    assert "give --overwrite" in error_of(meshslam("convert", "recording", folder, copy))
    done("convert", "recording", folder, copy, "--overwrite")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("")
    given = ("convert", "recording", folder, tmp_path / "mine", "--overwrite")
    assert "no converted recording" in error_of(meshslam(*given))
    assert "name another folder" in error_of(meshslam("convert", "recording", folder, folder, "--overwrite"))
    assert "meshslam convert recording IN OUT" in error_of(meshslam("convert", "recording", folder))
    assert "--sequence" in error_of(meshslam("convert", "yolo", folder))


@pytest.mark.parametrize("storage", ["ros1", "ros2"])
def test_a_bag_becomes_a_folder(storage, folder, tmp_path):  # noqa: F811
    pytest.importorskip("rosbags")
    from tests.sequences.bag_writing import IMAGE, INFO, Ros, Said, write_ros1, write_ros2

    own, ros = open_sequence(folder), Ros(int(storage[-1]))
    said = [Said(INFO, 1, ros.info(0, CAMERA))]
    for i, time_s in enumerate(own.times_s):
        ns = round(time_s * 1e9) + 1
        said.append(Said(IMAGE, ns, ros.image(ns, own.read_image(i))))
    bag = (write_ros1 if storage == "ros1" else write_ros2)(tmp_path / "drive.bag", ros, said)
    output = done("convert", "recording", bag, tmp_path / "copy")
    assert "5 frames, 0 poses, 0 IMU samples" in output.stdout
    assert "the only topic with images" in output.stderr
    copy = open_sequence(tmp_path / "copy")
    for i in range(FRAMES):
        np.testing.assert_array_equal(copy.read_image(i), own.read_image(i))
