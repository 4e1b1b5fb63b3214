"""Messages in: what is used, what is refused and why."""

import array
import re

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, CompressedImage, Imu

from meshslam.geometry import Camera
from meshslam.ros2.inputs import Images, InputState, camera_of_message, camera_values, imu_sample
from meshslam.sequences import CameraFile, undistorted
from tests.ros2.publisher import compressed_message, header, image_message, info_message

CAMERA = Camera(64, 48, 50.0, 51.0, 31.0, 23.0)
FIRST_S = 1_700_000_000.25


@pytest.fixture
def picture(rng):
    return rng.integers(0, 255, (48, 64, 3), dtype=np.uint8)


def images():
    return Images(InputState("images", "/camera/image_raw"))


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize("encoding", ["bgr8", "rgb8", "mono8"])
def test_raw_images_are_bgr_whatever_their_encoding_and_row_length(picture, encoding, padding):
    image, stamp = images().read(image_message(picture, FIRST_S, encoding, padding), CameraFile(CAMERA), 0.0)
    expected = np.repeat(picture[..., :1], 3, axis=2) if encoding == "mono8" else picture
    np.testing.assert_array_equal(image, expected)
    assert stamp == round(FIRST_S * 1e9)


def test_compressed_images_are_read(picture):
    image, _ = images().read(compressed_message(picture, FIRST_S), CameraFile(CAMERA), 0.0)
    np.testing.assert_array_equal(image, picture)


def test_distortion_is_removed_as_for_recordings(picture):
    coefficients = np.array([-0.3, 0.1, 0.001, -0.002, 0.0])
    lens, _ = undistorted(CAMERA, coefficients)
    state = InputState("camera info", "/camera/camera_info")
    camera = camera_of_message(info_message(CAMERA, FIRST_S, coefficients), "/camera/image_raw", state, 0.0)
    image, _ = images().read(image_message(picture, FIRST_S, "bgr8"), camera, 0.0)
    np.testing.assert_array_equal(image, lens.undistort_image(picture))
    assert not np.array_equal(image, picture)


def test_rectified_topics_have_no_distortion():
    state = InputState("camera info", "/camera/camera_info")
    message = info_message(CAMERA, FIRST_S, [-0.3, 0.1, 0.0, 0.0, 0.0])
    assert camera_of_message(message, "/camera/image_rect", state, 0.0).distortion is None


def test_images_that_come_late_are_counted_and_the_next_goes_on(picture):
    taken, camera = images(), CameraFile(CAMERA)
    for at in (0.0, 0.1, 0.05, 0.1, 0.2):
        taken.read(image_message(picture, FIRST_S + at), camera, at)
    assert (taken.state.received, taken.state.refused, taken.state.late) == (5, 2, 2)
    assert taken.state.why == ""


@pytest.mark.parametrize(
    ("at_s", "said"),
    [(-FIRST_S, "no stamp"), (-1.0, "came too late"), (-60.0, "the clock was set back.*~/reset")],
)
def test_why_an_image_is_not_used_is_said(picture, at_s, said):
    taken = images()
    taken.read(image_message(picture, FIRST_S), CameraFile(CAMERA), 0.0)
    assert taken.read(image_message(picture, FIRST_S + at_s), CameraFile(CAMERA), 0.0) is None
    assert re.search(said, taken.state.why)


def test_images_of_another_size_or_damaged_are_refused(picture):
    taken, camera = images(), CameraFile(CAMERA)
    assert taken.read(image_message(picture[:40], FIRST_S), camera, 0.0) is None
    assert "64x40, but the camera's resolution is 64x48" in taken.state.why
    cut = image_message(picture, FIRST_S)
    cut.data = cut.data[:100]
    assert taken.read(cut, camera, 0.0) is None
    assert "100 bytes for an image" in taken.state.why
    data = array.array("B", cv2.imencode(".png", picture)[1].tobytes()[:200])
    broken = CompressedImage(header=header(FIRST_S, ""), format="png", data=data)
    assert taken.read(broken, camera, 0.0) is None
    assert taken.state.refused == 3
    assert taken.read(image_message(picture, FIRST_S), camera, 0.0) is not None


def imu(values=(0.1, 0.2, 0.3, 1.0, 2.0, 9.0), at_s=FIRST_S):
    message = Imu(header=header(at_s, "imu"))
    w, a = message.angular_velocity, message.linear_acceleration
    w.x, w.y, w.z, a.x, a.y, a.z = (float(v) for v in values)
    return message


def test_a_sample_is_put_on_the_cameras_clock():
    state = InputState("IMU", "/imu")
    sample = imu_sample(imu(), state, 0.05, 0.0)
    assert sample.times_s == pytest.approx([FIRST_S - 0.05], abs=1e-6)
    np.testing.assert_array_equal(sample.angular_rate_rad_s, [[0.1, 0.2, 0.3]])
    np.testing.assert_array_equal(sample.specific_force_m_s2, [[1.0, 2.0, 9.0]])


def test_samples_that_cannot_be_used_are_refused():
    state = InputState("IMU", "/imu")
    assert imu_sample(imu((np.nan, 0, 0, 0, 0, 9.8)), state, 0.0, 0.0) is None
    assert "NaN" in state.why
    lacking = imu()
    lacking.linear_acceleration_covariance[0] = -1.0
    assert imu_sample(lacking, state, 0.0, 0.0) is None
    assert "no specific force" in state.why
    assert imu_sample(imu(at_s=0.0), state, 0.0, 0.0) is None
    assert "no stamp" in state.why
    assert state.refused == 3
    assert imu_sample(imu(), state, 0.0, 0.0) is not None


def test_a_calibration_that_is_none_says_the_way_out():
    state = InputState("camera info", "/camera/camera_info")
    assert camera_of_message(CameraInfo(header=header(FIRST_S, "c")), "/camera/image_raw", state, 0.0) is None
    assert "not calibrated" in state.why
    assert "--camera FILE" in state.why


def test_a_changed_calibration_is_another_one():
    other = info_message(CAMERA, FIRST_S + 1)
    assert camera_values(info_message(CAMERA, FIRST_S)) == camera_values(other)
    other.k[0] = 52.0
    assert camera_values(info_message(CAMERA, FIRST_S)) != camera_values(other)
