import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from meshslam.geometry import Camera, Pose
from meshslam.sequences import (
    Distortion,
    ImuSamples,
    InitialState,
    check_sequence,
    open_sequence,
    write_sequence_folder,
)
from meshslam.sequences.tum import format_tum
from tests.sequences.conftest import CAMERA, FRAMES, coco_document, random_image, random_pose


def test_what_is_written_is_read(tmp_path, rng):
    times_s = np.cumsum(rng.uniform(0.05, 0.15, 4))
    images = [random_image(rng) for _ in times_s]
    poses = [random_pose(rng) for _ in times_s]
    imu = ImuSamples(np.arange(60) * 0.01, rng.normal(size=(60, 3)), rng.normal(size=(60, 3)))
    start = InitialState(float(times_s[0]), poses[0], rng.normal(size=3))
    camera = Camera(64, 48, 60.0, 61.0, 31.0, 23.0, 0.5)
    write_sequence_folder(
        tmp_path / "s",
        camera,
        times_s,
        images=images,
        detections=coco_document(4),
        world_from_camera=poses,
        imu=imu,
        imu_from_camera=poses[1],
        initial_state=start,
        height_above_ground_m=1.4,
    )
    assert check_sequence(tmp_path / "s") == []
    sequence = open_sequence(tmp_path / "s")
    assert (sequence.name, sequence.layout, sequence.camera, sequence.frame_ids) == (
        "s",
        "folder",
        camera,
        (0, 1, 2, 3),
    )
    assert np.allclose(sequence.times_s, times_s, atol=1e-9)
    for i, image in enumerate(images):
        assert (sequence.read_image(i) == image).all()
    for read, pose in zip(sequence.world_from_camera, poses, strict=True):
        assert np.allclose(read.matrix, pose.matrix, atol=1e-7)
    assert np.allclose(sequence.imu.angular_rate_rad_s, imu.angular_rate_rad_s, atol=1e-8)
    assert np.allclose(sequence.imu.specific_force_m_s2, imu.specific_force_m_s2, atol=1e-8)
    assert np.allclose(sequence.imu_from_camera.matrix, poses[1].matrix, atol=1e-8)
    assert np.allclose(sequence.initial_state.velocity_in_world, start.velocity_in_world)
    assert np.allclose(sequence.initial_state.world_from_camera.matrix, poses[0].matrix, atol=1e-8)
    assert sequence.height_above_ground_m == 1.4
    assert sequence.detections_path == tmp_path / "s" / "detections.json"
    assert sequence.imu.rate_hz == pytest.approx(100)


def test_grey_images_come_as_three_equal_channels(tmp_path, rng):
    grey = random_image(rng, (48, 64))
    folder = write_sequence_folder(tmp_path / "s", CAMERA, np.zeros(1), images=[grey])
    image = open_sequence(folder).read_image(0)
    assert image.shape == (48, 64, 3)
    assert (image == grey[..., None]).all()


def test_one_frame_is_a_sequence(tmp_path, rng):
    folder = write_sequence_folder(
        tmp_path / "s", CAMERA, np.zeros(1), images=[random_image(rng)], world_from_camera=[random_pose(rng)]
    )
    assert check_sequence(folder) == []
    assert len(open_sequence(folder)) == 1


def test_detections_stand_for_images(tmp_path):
    folder = write_sequence_folder(tmp_path / "s", CAMERA, np.arange(FRAMES) * 0.1, detections=coco_document())
    sequence = open_sequence(folder)
    assert sequence.image_paths is None
    assert sequence.frame_ids == tuple(range(FRAMES))


def test_frame_numbers_are_the_images_names(folder):
    for i in reversed(range(FRAMES)):
        (folder / "images" / f"{i:06d}.png").rename(folder / "images" / f"{i + 98:06d}.png")
    assert open_sequence(folder).frame_ids == tuple(range(98, 98 + FRAMES))


def test_names_that_are_no_numbers_are_taken_in_order(folder):
    for i in range(FRAMES):
        (folder / "images" / f"{i:06d}.png").rename(folder / "images" / f"frame_{i}.png")
    sequence = open_sequence(folder)
    assert sequence.frame_ids == tuple(range(FRAMES))
    assert [p.name for p in sequence.image_paths] == [f"frame_{i}.png" for i in range(FRAMES)]


def test_numbers_of_different_length_are_ordered_as_numbers(folder):
    (folder / "images" / "000004.png").rename(folder / "images" / "10.png")
    assert open_sequence(folder).frame_ids == (0, 1, 2, 3, 10)


def test_poses_are_found_by_time(folder, rng):
    sequence = open_sequence(folder)
    times_s = np.arange(-30, 80) * 0.01 + 0.002
    poses = [Pose(Rotation.from_euler("z", t).as_matrix(), np.array([t, 0.0, 0.0])) for t in times_s]
    (folder / "poses.tum").write_text("# time x y z qx qy qz qw\n" + format_tum(times_s, poses))
    for pose, time in zip(open_sequence(folder).world_from_camera, sequence.times_s, strict=True):
        assert pose.translation[0] == pytest.approx(time, abs=0.0021)


def test_truth_files_are_never_opened(folder):
    for name in ("groundtruth.tum", "objects.json", "association.json"):
        (folder / name).write_text("not to be read")
    assert check_sequence(folder) == []
    open_sequence(folder)


def test_opencv_yaml_is_read(folder):
    (folder / "camera.yaml").write_text(
        "%YAML:1.0\n---\nmodel: pinhole\nresolution: [64, 48]\nintrinsics: [60.0, 61.0, 31.5, 23.5]\n"
        "imu_from_camera: !!opencv-matrix\n  rows: 4\n  cols: 4\n  dt: d\n"
        "  data: [0., 0., 1., 0.1, -1., 0., 0., 0.2, 0., -1., 0., 0.3, 0., 0., 0., 1.]\n"
    )
    sequence = open_sequence(folder)
    assert sequence.camera == CAMERA
    assert sequence.imu_from_camera.translation.tolist() == [0.1, 0.2, 0.3]


RADTAN = np.array([-0.28, 0.07, 0.0003, -0.0002])


@pytest.mark.parametrize(
    "coefficients", [RADTAN, np.append(RADTAN, 0.01), np.array([0.2, 0.01, -0.002, 0.001]), np.zeros(4)]
)
def test_distortion_and_its_inverse_cancel(coefficients, rng):
    raw = Camera(752, 480, 458.654, 457.296, 367.215, 248.375, 0.3)
    distortion = Distortion(raw, raw, coefficients)
    pixels = rng.uniform([0, 0], [751, 479], (500, 2))
    assert np.abs(distortion.distort(distortion.undistort(pixels)) - pixels).max() < 1e-6


def test_distortion_is_that_of_opencv(rng):
    import cv2

    raw = Camera(752, 480, 458.654, 457.296, 367.215, 248.375)
    points = rng.uniform([-1, -0.8, 1], [1, 0.8, 1], (200, 3))
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), raw.matrix, RADTAN)
    assert np.allclose(Distortion(raw, raw, RADTAN).distort(raw.project(points)), expected[:, 0], atol=1e-6)


def test_images_come_undistorted(tmp_path):
    raw = Camera(320, 240, 200.0, 200.0, 159.5, 119.5)
    distortion = Distortion(raw, raw, RADTAN)
    v, u = np.mgrid[:240, :320].astype(float)
    straight = distortion.undistort(np.stack([u, v], axis=-1))
    bent = (np.abs(straight[..., 0] - 100) < 3).astype(np.uint8) * 255  # what a straight upright bar looks like
    folder = write_sequence_folder(tmp_path / "s", raw, np.zeros(1), images=[bent], distortion=distortion)
    image = open_sequence(folder).read_image(0)[..., 0]
    rows = image[20:-20]
    centres = (rows * np.arange(320.0)).sum(1) / rows.sum(1)
    assert np.abs(centres - 100).max() < 0.5
    assert np.ptp((bent[20:-20] * np.arange(320.0)).sum(1) / bent[20:-20].sum(1)) > 3


def edit_yaml(file, **changes):
    content = yaml.safe_load(file.read_text()) | changes
    file.write_text(yaml.safe_dump({k: v for k, v in content.items() if v != "drop"}))


def edit_line(file, line, text):
    lines = file.read_text().splitlines()
    lines[line - 1] = text
    file.write_text("\n".join(lines) + "\n")


def cut(file, share=0.5):
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])


IDENTITY = np.eye(4).tolist()
CAMERA_PROBLEMS = [
    ({"intrinsics": "drop"}, "intrinsics: key is missing"),
    ({"resolution": "drop"}, "resolution: key is missing"),
    ({"intrinsics": [60.0, 61.0, 31.5]}, "intrinsics: expected 4 numbers, found 3"),
    ({"intrinsics": [60.0, float("nan"), 31.5, 23.5]}, "intrinsics: expected finite numbers"),
    ({"intrinsics": [-60.0, 61.0, 31.5, 23.5]}, "intrinsics: a camera's focal lengths are positive"),
    ({"intrinsics": "wide"}, "intrinsics: expected numbers, found 'wide'"),
    ({"resolution": [64.5, 48]}, "resolution: expected"),
    ({"resolution": [0, 48]}, "resolution: expected"),
    ({"skew": [1.0, 2.0]}, "skew: expected one number"),
    ({"model": "fisheye"}, "model: expected pinhole, found 'fisheye'"),
    ({"distortion_model": "mei"}, "distortion_model: expected none, radtan, rational, equidistant, fov, found 'mei'"),
    ({"distortion_model": "radtan", "distortion_coeffs": [0.1]}, "distortion_coeffs: radtan has"),
    (
        {"distortion_model": "radtan", "distortion_coeffs": [-9.0, 0.0, 0.0, 0.0]},
        "distortion_coeffs: the distortion folds",
    ),
    ({"distortion_coeffs": [0.1, 0.0, 0.0, 0.0]}, "distortion_model: is none"),
    ({"imu_from_camera": [[2.0, 0, 0, 0], *IDENTITY[1:]]}, "imu_from_camera: a pose's rotation must be orthonormal"),
    ({"imu_from_camera": [1.0, 2.0]}, "imu_from_camera: expected a 4x4 matrix"),
    ({"height_above_ground_m": -1.0}, "height_above_ground_m: expected a positive number"),
]


@pytest.mark.parametrize(("changes", "message"), CAMERA_PROBLEMS)
def test_camera_problems_name_their_key(folder, changes, message, expect_problem):
    edit_yaml(folder / "camera.yaml", **changes)
    expect_problem(folder, f"camera.yaml: {message}")


FILE_PROBLEMS = {
    "no camera": (lambda f: (f / "camera.yaml").unlink(), "camera.yaml: no such file"),
    "camera is no yaml": (lambda f: (f / "camera.yaml").write_text("a: [1"), "camera.yaml: line 1: not valid YAML"),
    "camera is a list": (lambda f: (f / "camera.yaml").write_text("- 1\n"), "camera.yaml: expected `key: value`"),
    "binary camera": (
        lambda f: (f / "camera.yaml").write_bytes(b"\xff\xfe\x00"),
        "camera.yaml: cannot be read as text",
    ),
    "no times": (lambda f: (f / "times.txt").unlink(), "times.txt: no such file"),
    "empty times": (lambda f: (f / "times.txt").write_text("\n"), "times.txt: holds no times: the sequence is empty"),
    "times go back": (
        lambda f: edit_line(f / "times.txt", 3, "0.05"),
        "times.txt: line 3: time 0.05 s is not after 0.1 s",
    ),
    "times stand": (lambda f: edit_line(f / "times.txt", 3, "0.1"), "times.txt: line 3: time 0.1 s is not after 0.1 s"),
    "NaN time": (lambda f: edit_line(f / "times.txt", 2, "nan"), "times.txt: line 2: expected finite numbers"),
    "no number": (
        lambda f: edit_line(f / "times.txt", 2, "soon"),
        "times.txt: line 2: expected 1 numbers, found 'soon'",
    ),
    "too few times": (
        lambda f: (f / "times.txt").write_text("0\n0.1\n"),
        "times.txt: 2 times, but images/ holds 5 images",
    ),
    "too few images": (
        lambda f: (f / "images" / "000004.png").unlink(),
        "times.txt: 5 times, but images/ holds 4 images",
    ),
    "a frame twice": (
        lambda f: (f / "images" / "000004.png").rename(f / "images" / "3.png"),
        "a second image of frame 3",
    ),
    "no images": (lambda f: [p.unlink() for p in (f / "images").iterdir()], "images: holds no images"),
    "no poses": (lambda f: (f / "poses.tum").write_text(""), "poses.tum: holds no poses"),
    "NaN pose": (lambda f: edit_line(f / "poses.tum", 2, "0.1 0 nan 0 0 0 0 1"), "poses.tum: line 2: expected finite"),
    "short pose": (
        lambda f: edit_line(f / "poses.tum", 2, "0.1 0 0 0"),
        "poses.tum: line 2: expected 8 numbers, found 4",
    ),
    "long quaternion": (
        lambda f: edit_line(f / "poses.tum", 2, "0.1 0 0 0 0 0 1 1"),
        "poses.tum: line 2: the quaternion's",
    ),
    "zero quaternion": (
        lambda f: edit_line(f / "poses.tum", 2, "0.1 0 0 0 0 0 0 0"),
        "poses.tum: line 2: the quaternion's",
    ),
    "imu header": (
        lambda f: edit_line(f / "imu.csv", 1, "t,x,y,z"),
        "imu.csv: line 1: expected the header timestamp,wx",
    ),
    "imu NaN": (
        lambda f: edit_line(f / "imu.csv", 9, "0.05,1,2,3,4,5,nan"),
        "imu.csv: line 9: expected finite numbers",
    ),
    "imu goes back": (
        lambda f: edit_line(f / "imu.csv", 9, "0.01,1,2,3,4,5,6"),
        "imu.csv: line 9: time 0.01 s is not after",
    ),
    "imu empty": (lambda f: cut_lines(f / "imu.csv", 1), "imu.csv: holds no samples"),
    "imu of another clock": (lambda f: shift_imu(f / "imu.csv", 1e9), "imu.csv: no sample lies between"),
    "no start velocity": (
        lambda f: edit_yaml(f / "initial_state.yaml", velocity_in_world="drop"),
        "velocity_in_world: key is",
    ),
    "start is no pose": (
        lambda f: edit_yaml(f / "initial_state.yaml", world_from_camera=[1]),
        "world_from_camera: expected a",
    ),
    "no start pose": (
        lambda f: edit_yaml(f / "initial_state.yaml", world_from_camera="drop"),
        "world_from_camera: key is",
    ),
}


def cut_lines(file, count):
    file.write_text("".join(f"{line}\n" for line in file.read_text().splitlines()[:count]))


def shift_imu(file, by_s):
    header, *rows = file.read_text().splitlines()
    shifted = [",".join([str(float(row.split(",")[0]) + by_s), *row.split(",")[1:]]) for row in rows]
    file.write_text("\n".join([header, *shifted]) + "\n")


@pytest.mark.parametrize("name", FILE_PROBLEMS)
def test_file_problems_name_file_and_line(folder, name, expect_problem):
    damage, message = FILE_PROBLEMS[name]
    damage(folder)
    expect_problem(folder, message)


def test_neither_images_nor_detections(folder, expect_problem):
    (folder / "detections.json").unlink()
    for image in (folder / "images").iterdir():
        image.unlink()
    (folder / "images").rmdir()
    expect_problem(folder, "neither images/ nor detections.json is there")


def test_a_camera_number_is_refused(folder):
    from meshslam.errors import SequenceError

    with pytest.raises(SequenceError, match="has one camera"):
        open_sequence(folder, camera_number=2)


def test_imu_and_mounting_come_back_to_the_last_bit(tmp_path, rng):
    """Else a copied recording gives another trajectory than the one that it was copied from."""
    imu = ImuSamples(1.7e9 + np.arange(200) / 300, rng.normal(size=(200, 3)), rng.normal(size=(200, 3)))
    mounted = random_pose(rng)
    write_sequence_folder(tmp_path / "s", CAMERA, imu.times_s[10:14], imu=imu, imu_from_camera=mounted)
    (tmp_path / "s" / "detections.json").write_text('{"images": [], "annotations": [], "categories": []}')
    found = open_sequence(tmp_path / "s")
    np.testing.assert_array_equal(found.imu.times_s, imu.times_s)
    np.testing.assert_array_equal(found.imu.angular_rate_rad_s, imu.angular_rate_rad_s)
    np.testing.assert_array_equal(found.imu.specific_force_m_s2, imu.specific_force_m_s2)
    np.testing.assert_array_equal(found.imu_from_camera.matrix, mounted.matrix)
