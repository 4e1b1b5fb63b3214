import numpy as np
import pytest

from meshslam.errors import SequenceError
from meshslam.sequences import check_sequence, open_sequence
from meshslam.sequences.kitti_odometry import WORLD_FROM_FIRST_CAMERA
from tests.sequences.conftest import FRAMES


def test_times_and_poses_are_cut_to_the_images(odometry):
    sequence = open_sequence(odometry)
    assert check_sequence(odometry) == []
    assert len(sequence) == len(sequence.world_from_camera) == FRAMES
    assert np.allclose(sequence.times_s, 0.1 * np.arange(FRAMES))
    assert (sequence.camera.width, sequence.camera.height, sequence.height_above_ground_m) == (64, 48, 1.65)


def test_the_first_pose_renames_the_axes(odometry):
    first = open_sequence(odometry).world_from_camera[0]
    assert np.allclose(first.matrix, WORLD_FROM_FIRST_CAMERA.matrix)
    assert np.allclose(first.transform(np.array([1.0, 2.0, 3.0])), [3, -1, -2])


def test_camera_2_stands_where_its_projection_puts_it(odometry, rng):
    left, colour = open_sequence(odometry, camera_number=0), open_sequence(odometry, camera_number=2)
    p2 = np.array([60, 0, 31.5, 3.6, 0, 60, 23.5, 0.012, 0, 0, 1, 0.006]).reshape(3, 4)
    points_in_camera0 = rng.uniform([-3, -2, 4], [3, 2, 20], (50, 3))
    expected = np.column_stack([points_in_camera0, np.ones(50)]) @ p2.T
    for a, b in zip(left.world_from_camera, colour.world_from_camera, strict=True):
        pixels = colour.camera.project(b.inverse().transform(a.transform(points_in_camera0)))
        assert np.allclose(pixels, expected[:, :2] / expected[:, 2:], atol=1e-9)


def test_frames_from_the_middle_keep_their_times_and_poses(odometry):
    whole = open_sequence(odometry)
    for i in (0, 1):
        (odometry / "image_0" / f"{i:06d}.png").unlink()
    rest = open_sequence(odometry)
    assert rest.frame_ids == (2, 3, 4)
    assert np.allclose(rest.times_s, whole.times_s[2:])
    assert np.allclose(rest.world_from_camera[0].matrix, whole.world_from_camera[2].matrix)


def test_poses_are_found_beside_a_sequences_folder(odometry, tmp_path):
    (tmp_path / "sequences").mkdir()
    moved = odometry.rename(tmp_path / "sequences" / "07")
    assert open_sequence(moved).world_from_camera is not None
    (tmp_path / "poses").rename(tmp_path / "elsewhere")
    assert open_sequence(moved).world_from_camera is None


def test_colour_is_taken_where_there_is_no_grey(odometry):
    (odometry / "image_0").rename(odometry / "other")
    assert "image_2" in str(open_sequence(odometry).image_paths[0])


def replace(file, old, new):
    file.write_text(file.read_text().replace(old, new, 1))


PROBLEMS = {
    "no calibration": (lambda p: (p / "calib.txt").unlink(), "calib.txt: no such file"),
    "no key": (lambda p: replace(p / "calib.txt", "P0:", "Q0:"), "calib.txt: P0: key is missing"),
    "short key": (lambda p: (p / "calib.txt").write_text("P0: 1 2 3\n"), "calib.txt: P0: expected 12 finite numbers"),
    "NaN key": (lambda p: replace(p / "calib.txt", "P0: 60", "P0: nan"), "calib.txt: P0: expected 12 finite numbers"),
    "no focal length": (
        lambda p: replace(p / "calib.txt", "P0: 60", "P0: 0"),
        "calib.txt: P0: a camera's focal lengths",
    ),
    "word in key": (lambda p: replace(p / "calib.txt", "P0: 60", "P0: wide"), "calib.txt: P0: expected 12 numbers"),
    "no times": (lambda p: (p / "times.txt").unlink(), "times.txt: no such file"),
    "few times": (lambda p: (p / "times.txt").write_text("0\n1\n"), "times.txt: 2 times, but 000004.png needs line 5"),
    "times go back": (
        lambda p: replace(p / "times.txt", "2.000000e-01", "0"),
        "times.txt: line 3: time 0 s is not after",
    ),
    "few poses": (lambda p: cut(p.parent / "poses" / "07.txt", 3), "07.txt: 3 poses, but frame 4 needs line 5"),
    "NaN pose": (
        lambda p: replace(p.parent / "poses" / "07.txt", "1.000000000e+00", "nan"),
        "07.txt: line 1: expected finite",
    ),
    "skewed pose": (
        lambda p: replace(p.parent / "poses" / "07.txt", "1.0", "1.2"),
        "07.txt: line 1: a pose's rotation",
    ),
    "no images": (lambda p: [f.unlink() for f in (p / "image_0").iterdir()], "image_0: holds no images"),
    "bad first image": (lambda p: (p / "image_0" / "000000.png").write_bytes(b""), "000000.png: image is empty"),
    "named image": (
        lambda p: (p / "image_0" / "000000.png").rename(p / "image_0" / "a.png"),
        "a.png: the file's name is no",
    ),
}


def cut(file, lines):
    file.write_text("\n".join(file.read_text().splitlines()[:lines]) + "\n")


@pytest.mark.parametrize("name", PROBLEMS)
def test_problems_name_file_and_key(odometry, name, expect_problem):
    damage, message = PROBLEMS[name]
    damage(odometry)
    expect_problem(odometry, message)


def test_an_unknown_camera_is_refused(odometry):
    with pytest.raises(SequenceError, match="not 7"):
        open_sequence(odometry, camera_number=7)
    with pytest.raises(SequenceError, match="image_3: no such folder"):
        open_sequence(odometry, camera_number=3)


@pytest.mark.data
def test_sequence_06(data_folder):
    sequence = open_sequence(data_folder / "kitti_odometry" / "06")
    assert check_sequence(data_folder / "kitti_odometry" / "06") == []
    assert len(sequence) == 51
    assert sequence.image_paths[-1].name == "000050.png"
    assert np.allclose(sequence.world_from_camera[0].matrix, WORLD_FROM_FIRST_CAMERA.matrix, atol=1e-8)
    heights_m = np.array([pose.translation[2] for pose in sequence.world_from_camera])
    path_m = np.linalg.norm(np.diff([pose.translation for pose in sequence.world_from_camera], axis=0), axis=1)
    assert (
        (path_m / np.diff(sequence.times_s) > 10) & (path_m / np.diff(sequence.times_s) < 15)
    ).all()  # a car in town
    assert np.ptp(heights_m) < 0.03 * path_m.sum()
    for pose in sequence.world_from_camera:
        assert pose.rotation[2, 1] < -0.99  # the camera's y axis points down
    image = sequence.read_image(0)
    assert image.shape == (370, 1226, 3)
    assert (image[..., 0] == image[..., 1]).all()
