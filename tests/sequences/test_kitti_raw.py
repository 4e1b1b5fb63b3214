import shutil

import numpy as np
import pytest

from meshslam.errors import SequenceError
from meshslam.sequences import check_sequence, open_sequence
from meshslam.sequences.oxts import read_oxts, regular_times, world_from_imu
from meshslam.sequences.report import Report
from tests.sequences.conftest import FRAMES, write_stamps

DRIVE_0048 = "kitti_raw/2011_09_26/2011_09_26_drive_0048_sync"


def test_the_generated_drive_goes_north(raw):
    sequence = open_sequence(raw)
    assert check_sequence(raw) == []
    assert sequence.frame_ids == tuple(range(FRAMES))
    assert np.allclose(sequence.times_s, 0.1 * np.arange(FRAMES))
    for i, pose in enumerate(sequence.world_from_camera):
        assert np.allclose(pose.rotation, [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-9)  # it looks north, upright
        imu_from_camera = sequence.imu_from_camera.translation
        imu = pose.translation - np.array([-imu_from_camera[1], imu_from_camera[0], imu_from_camera[2]])
        assert np.allclose(imu, [0, i - 0.1, 0], atol=1e-4)  # 10 m/s, 10 ms before OXTS


def test_imu_from_camera_chains_the_three_files(raw):
    camera = open_sequence(raw).imu_from_camera
    # from the velodyne the camera is 0.27 m ahead, 3.6 / 60 m left and 0.08 m lower, the imu 0.81 m back, 0.32 m left
    assert np.allclose(camera.rotation, [[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    assert np.allclose(camera.translation, [0.27 + 0.81, 0.06 - 0.32, -0.08 + 0.8])


def test_imu_is_that_of_the_body_axes(raw):
    imu = open_sequence(raw).imu
    assert np.allclose(imu.specific_force_m_s2, [0.1, 0.2, 9.81])
    assert np.allclose(imu.angular_rate_rad_s, [0.01, 0.02, 0.03])
    assert np.allclose(imu.times_s, 0.01 + 0.1 * np.arange(FRAMES), atol=1e-9)


def test_the_fast_recording_beside_is_taken(raw):
    fast = raw.with_name(raw.name.replace("_sync", "_extract")) / "oxts"
    (fast / "data").mkdir(parents=True)
    row = (raw / "oxts" / "data" / "0000000000.txt").read_text()
    for i in range(60):
        (fast / "data" / f"{i:010d}.txt").write_text(row)
    write_stamps(fast / "timestamps.txt", -0.05, 60, 0.01)
    sequence = open_sequence(raw)
    assert len(sequence.imu.times_s) == 60
    assert sequence.imu.rate_hz == pytest.approx(100)
    (fast / "timestamps.txt").unlink()
    with pytest.raises(SequenceError, match=r"_extract/oxts/timestamps\.txt: no such file"):
        open_sequence(raw)


def test_one_frame_is_fine(raw):
    for i in range(1, FRAMES):
        (raw / "image_02" / "data" / f"{i:010d}.png").unlink()
        (raw / "oxts" / "data" / f"{i:010d}.txt").unlink()
    assert len(open_sequence(raw)) == 1


def test_jumps_in_recorded_times_are_put_in_line(rng):
    true_s = np.arange(300) * 0.01
    recorded_s = true_s + rng.normal(0, 1e-4, 300)
    recorded_s[[100, 101, 102, 200]] += 0.06
    assert np.abs(regular_times(recorded_s) - true_s).max() < 1e-3


def test_a_gap_in_recorded_times_stays(rng):
    true_s = np.arange(300) * 0.01
    true_s[150:] += 1.0
    assert np.array_equal(regular_times(true_s), true_s)


def test_steps_on_the_mercator_map_are_metres_on_the_ellipsoid(rng):
    latitude, longitude = 49.0, 8.4
    rows = np.zeros((3, 30))
    rows[:, :2] = [[latitude, longitude], [latitude + 1e-4, longitude], [latitude, longitude + 1e-4]]
    east, north = world_from_imu(rows, rows[0])[2].translation[0], world_from_imu(rows, rows[0])[1].translation[1]
    assert north == pytest.approx(np.radians(1e-4) * 6378137.0, rel=1e-5)
    assert east == pytest.approx(np.radians(1e-4) * 6378137.0 * np.cos(np.radians(latitude)), rel=1e-5)


def replace(file, old, new):
    file.write_text(file.read_text().replace(old, new, 1))


OXTS = "oxts/data/0000000002.txt"
PROBLEMS = {
    "no projection": (
        lambda p: replace(p.parent / "calib_cam_to_cam.txt", "P_rect_02", "P_rect_09"),
        "P_rect_02: key is missing",
    ),
    "no size": (
        lambda p: replace(p.parent / "calib_cam_to_cam.txt", "S_rect_02", "S_rect_09"),
        "S_rect_02: key is missing",
    ),
    "no rotation": (
        lambda p: replace(p.parent / "calib_velo_to_cam.txt", "R:", "Q:"),
        "calib_velo_to_cam.txt: R: key is",
    ),
    "no lever arm": (
        lambda p: replace(p.parent / "calib_imu_to_velo.txt", "T:", "Q:"),
        "calib_imu_to_velo.txt: T: key is",
    ),
    "no rigid transform": (
        lambda p: replace(p.parent / "calib_imu_to_velo.txt", "R: 1", "R: 2"),
        "R: a pose's rotation must be",
    ),
    "no calibration": (lambda p: (p.parent / "calib_velo_to_cam.txt").unlink(), "calib_velo_to_cam.txt: no such file"),
    "no oxts": (lambda p: shutil.rmtree(p / "oxts"), "oxts/timestamps.txt: no such file"),
    "no samples": (lambda p: shutil.rmtree(p / "oxts" / "data"), "oxts/data: no such folder, or no samples"),
    "a sample missing": (lambda p: (p / OXTS).unlink(), f"{OXTS}: no such sample, but frame 2 needs"),
    "last sample missing": (
        lambda p: (p / "oxts/data/0000000004.txt").unlink(),
        "0000000004.txt: no such sample, but frame 4",
    ),
    "NaN sample": (lambda p: replace(p / OXTS, "8.4", "nan"), f"{OXTS}: line 1: expected finite numbers"),
    "short sample": (lambda p: (p / OXTS).write_text("1 2 3\n"), f"{OXTS}: line 1: expected 30 numbers, found 3"),
    "empty sample": (lambda p: (p / OXTS).write_text(""), f"{OXTS}: expected one line of 30 numbers"),
    "few image times": (
        lambda p: write_stamps(p / "image_02/timestamps.txt", 0, 3),
        "image_02/timestamps.txt: 3 lines, but",
    ),
    "few oxts times": (
        lambda p: write_stamps(p / "oxts/timestamps.txt", 0, 3),
        "oxts/timestamps.txt: 3 lines: none for",
    ),
    "no image times": (
        lambda p: (p / "image_02/timestamps.txt").write_text(""),
        "image_02/timestamps.txt: holds no times",
    ),
    "times go back": (
        lambda p: replace(p / "image_02/timestamps.txt", "10.2", "10.0"),
        "image_02/timestamps.txt: line 3: this",
    ),
    "oxts times go back": (
        lambda p: replace(p / "oxts/timestamps.txt", "10.21", "10.01"),
        "oxts/timestamps.txt: line 3: this",
    ),
    "no time": (
        lambda p: replace(p / "image_02/timestamps.txt", "10.2", "xx"),
        "image_02/timestamps.txt: line 3: expected a",
    ),
    "NaT": (lambda p: (p / "image_02/timestamps.txt").write_text("NaT\n"), "timestamps.txt: line 1: expected a time"),
    "other clock": (
        lambda p: write_stamps(p / "oxts/timestamps.txt", 30.0),
        "oxts/timestamps.txt: no pose at 0.000000 s",
    ),
    "no images": (lambda p: shutil.rmtree(p / "image_02" / "data"), "image_02/data: no such folder"),
    "no camera": (lambda p: (p / "image_02").rename(p / "image_03"), "image_02: no such folder; there is image_03"),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_problems_name_file_and_key(raw, name, expect_problem):
    damage, message = PROBLEMS[name]
    damage(raw)
    expect_problem(raw, message)


def test_an_image_of_another_size_is_found(raw):
    replace(raw.parent / "calib_cam_to_cam.txt", "S_rect_02: 64", "S_rect_02: 66")
    assert len(check_sequence(raw)) == FRAMES
    with pytest.raises(SequenceError, match="image is 64x48, but the camera's resolution is 66x48"):
        open_sequence(raw).read_image(0)


@pytest.fixture(scope="module")
def drive(data_folder):
    return data_folder / DRIVE_0048


@pytest.mark.data
def test_drive_0048_is_sound(drive):
    assert check_sequence(drive) == []
    sequence = open_sequence(drive)
    assert len(sequence) == 22
    assert (sequence.camera.width, sequence.camera.height, sequence.camera.fx) == (1242, 375, 721.5377)
    assert sequence.read_image(21).shape == (375, 1242, 3)


@pytest.mark.data
def test_the_stereo_base_is_that_of_kitti(drive):
    left, right = open_sequence(drive), open_sequence(drive, camera_number=3)
    base = left.imu_from_camera.inverse() @ right.imu_from_camera
    assert np.allclose(base.rotation, np.eye(3), atol=1e-9)
    assert 0.53 < base.translation[0] < 0.54
    assert np.abs(base.translation[1:]).max() < 0.005
    for a, b in zip(left.world_from_camera, right.world_from_camera, strict=True):
        assert 0.53 < (a.inverse() @ b).translation[0] < 0.54


@pytest.mark.data
def test_the_camera_stands_upright_at_its_height(drive):
    sequence = open_sequence(drive)
    for pose in sequence.world_from_camera:
        assert pose.rotation[2, 1] < -0.99  # y points down
    # OXTS is mounted at 0.93 m above the road (setup sheet of KITTI): the cameras are at 1.65 m
    assert 0.93 + sequence.imu_from_camera.translation[2] == pytest.approx(1.65, abs=0.05)


@pytest.mark.data
def test_the_cameras_steps_are_the_speed_of_oxts(drive):
    sequence = open_sequence(drive)
    rows = read_oxts(drive / "oxts", Report()).rows
    steps = np.diff([pose.translation for pose in sequence.world_from_camera], axis=0)
    velocities = steps / np.diff(sequence.times_s)[:, None]
    recorded = np.column_stack([rows[:, 7], rows[:, 6], rows[:, 10]])  # east, north, up
    assert (
        np.abs(np.linalg.norm(velocities, axis=1) - np.linalg.norm((recorded[1:] + recorded[:-1]) / 2, axis=1)).max()
        < 0.3
    )
    assert np.linalg.norm(velocities.mean(0) - recorded.mean(0)) < 0.15
    forward = np.array([pose.rotation[:, 2] for pose in sequence.world_from_camera])
    assert ((velocities * forward[1:]).sum(1) / np.linalg.norm(velocities, axis=1)).min() > 0.99


@pytest.mark.data
def test_the_imu_feels_gravity_upwards(drive):
    sequence = open_sequence(drive)
    imu = sequence.imu
    assert 99 < imu.rate_hz < 101
    assert (np.diff(imu.times_s) > 0.005).all()
    assert (np.diff(imu.times_s) < 0.015).all()
    world_from_imu = sequence.world_from_camera[10] @ sequence.imu_from_camera.inverse()
    up = world_from_imu.rotation @ imu.specific_force_m_s2.mean(0)
    assert up[2] == pytest.approx(9.81, abs=0.1)
    assert np.linalg.norm(up[:2]) < 0.5


@pytest.mark.data
def test_the_gyro_turns_with_the_camera(drive):
    sequence = open_sequence(drive)
    imu, first, last = sequence.imu, sequence.world_from_camera[0], sequence.world_from_camera[-1]
    inside = (imu.times_s >= sequence.times_s[0]) & (imu.times_s <= sequence.times_s[-1])
    turned_rad = imu.angular_rate_rad_s[inside, 2].mean() * (sequence.times_s[-1] - sequence.times_s[0])
    heading = [np.arctan2(pose.rotation[1, 2], pose.rotation[0, 2]) for pose in (first, last)]
    assert heading[1] - heading[0] == pytest.approx(turned_rad, abs=0.01)
