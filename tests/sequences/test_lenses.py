import cv2
import numpy as np
import pytest

from meshslam.errors import GeometryError
from meshslam.geometry import Camera
from meshslam.sequences import Distortion, open_sequence, undistorted, write_sequence_folder
from tests.sequences.test_folder import edit_yaml

RAW = Camera(800, 600, 320.0, 322.0, 402.0, 297.0)
RADTAN = np.array([-0.28, 0.07, 0.0003, -0.0002, 0.01])
RATIONAL = np.array([0.9, 0.3, 0.0005, -0.0003, 0.01, 1.25, 0.5, 0.05])
FISHEYES = [np.zeros(4), np.array([-0.02, 0.003, -0.001, 0.0002]), np.array([0.1, -0.01, 0.0, 0.0])]
LENSES = [("rational", RATIONAL), ("fov", np.array([0.93])), *(("equidistant", k) for k in FISHEYES)]


def pixels_of(camera, rng, count=400):
    return rng.uniform([0, 0], [camera.width - 1, camera.height - 1], (count, 2))


@pytest.mark.parametrize(("model", "coefficients"), [("radtan", RADTAN), ("rational", RATIONAL)])
def test_radtan_and_rational_are_those_of_opencv(model, coefficients, rng):
    raw = Camera(752, 480, 458.654, 457.296, 367.215, 248.375)
    lens, _ = undistorted(raw, coefficients, model)
    assert lens.camera == raw
    points = rng.uniform([-0.7, -0.5, 1], [0.7, 0.5, 1], (200, 3))
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), raw.matrix, coefficients)
    assert np.abs(lens.distort(raw.project(points)) - expected[:, 0]).max() < 1e-6
    assert np.abs(lens.project_raw(3 * points) - expected[:, 0]).max() < 1e-6
    maps = cv2.initUndistortRectifyMap(raw.matrix, coefficients, np.eye(3), raw.matrix, (752, 480), cv2.CV_32FC1)
    assert np.abs(np.array(lens._maps) - np.array(maps)).max() < 1e-3  # float32


@pytest.mark.parametrize("coefficients", FISHEYES)
def test_equidistant_is_that_of_opencv(coefficients, rng):
    lens, said = undistorted(RAW, coefficients, "equidistant")
    pixels = pixels_of(lens.camera, rng)
    directions = lens.camera.rays(pixels)[:, :2]
    expected = cv2.fisheye.distortPoints(directions[None], RAW.matrix, coefficients)[0]
    assert np.abs(lens.distort(pixels) - expected).max() < 1e-6
    size = (RAW.width, RAW.height)
    maps = cv2.fisheye.initUndistortRectifyMap(
        RAW.matrix, coefficients, np.eye(3), lens.camera.matrix, size, cv2.CV_32FC1
    )
    assert np.abs(np.array(lens._maps) - np.array(maps)).max() < 1e-3
    assert f"focal length {lens.camera.fx:.0f} px" in said


def test_fov_is_that_of_its_paper(rng):
    lens, _ = undistorted(RAW, np.array([0.93]), "fov")
    pixels = pixels_of(lens.camera, rng)
    x, y = lens.camera.rays(pixels)[:, :2].T
    r = np.hypot(x, y)
    bent = np.arctan(2 * r * np.tan(0.93 / 2)) / 0.93 / r
    expected = np.column_stack([RAW.fx * x * bent + RAW.cx, RAW.fy * y * bent + RAW.cy])
    assert np.abs(lens.distort(pixels) - expected).max() < 1e-9


@pytest.mark.parametrize(("model", "coefficients"), LENSES)
def test_each_lens_and_its_inverse_cancel(model, coefficients, rng):
    lens, _ = undistorted(RAW, coefficients, model)
    pixels = pixels_of(lens.camera, rng)
    assert np.abs(lens.undistort(lens.distort(pixels)) - pixels).max() < 1e-6
    raw = lens.distort(pixels)
    assert np.abs(lens.project_raw(2.5 * lens.raw_rays(raw)) - raw).max() < 1e-6
    assert np.abs(lens.camera.project(lens.raw_rays(raw)) - pixels).max() < 1e-6


@pytest.mark.parametrize("field_deg", [100.0, 150.0, 180.0, 220.0])
def test_a_fisheye_gets_a_view_that_it_fills(field_deg):
    focal_px = 1000 / np.radians(field_deg)
    raw = Camera(1000, 700, focal_px, focal_px, 495.0, 352.0)
    lens, said = undistorted(raw, np.zeros(4), "equidistant")
    assert lens.black_share() == 0.0
    assert (lens.camera.width, lens.camera.height, lens.camera.cx, lens.camera.cy) == (1000, 700, 499.5, 349.5)
    across = 2 * np.degrees(np.arctan(500 / lens.camera.fx))
    assert across <= 105.0001
    assert lens.camera.fx >= focal_px - 1e-3  # no less than the resolution of the raw centre
    assert f"pinhole view of {across:.0f} x" in said


def test_points_behind_a_fisheye_are_in_its_raw_image_only():
    focal_px = 1000 / np.radians(220)
    raw = Camera(1000, 1000, focal_px, focal_px, 499.5, 499.5)
    lens, _ = undistorted(raw, np.zeros(4), "equidistant")
    behind = np.array([np.sin(np.radians(100)), 0.0, np.cos(np.radians(100))])
    pixel = lens.project_raw(behind)
    assert np.allclose(pixel, [499.5 + focal_px * np.radians(100), 499.5])
    assert np.allclose(lens.raw_rays(pixel), behind)
    assert np.isnan(lens.undistort(pixel)).all()


def test_a_lens_that_folds_at_its_corners_shows_black_there(rng):
    raw = Camera(752, 480, 458.654, 457.296, 367.215, 248.375)
    folding = np.array([-0.4, 0.05, 0.0, 0.0])
    with pytest.raises(GeometryError, match="folds over within the image"):
        Distortion(raw, raw, folding)
    lens, said = undistorted(raw, folding)
    assert said.startswith("the distortion folds over 46 degrees off the axis: undistorted into a pinhole view of 79 x")
    pixels = raw.project(rng.uniform([-0.5, -0.4, 1], [0.5, 0.4, 1], (300, 3)))
    assert np.abs(lens.undistort(lens.distort(pixels)) - pixels).max() < 1e-6
    assert np.isnan(lens.undistort(np.array([2.0, 2.0]))).all()
    wide = Distortion(raw, Camera(752, 480, 150.0, 150.0, 375.5, 239.5), folding, partial=True)
    image = wide.undistort_image(np.full((480, 752), 255, np.uint8))
    assert image[240, 375] == 255
    assert (image[:, :100] == 0).all()  # without the fold's limit, a second image of the street would be here
    assert 0.3 < wide.black_share() < 1.0


@pytest.mark.parametrize(
    ("model", "coefficients", "said"),
    [
        ("radtan", [-9.0, 0.0, 0.0, 0.0], "folds over within the image: check the coefficients' order k1, k2, p1, p2"),
        ("rational", [0.1] * 5, "rational has k1, k2, p1, p2, k3, k4, k5, k6, found 5 numbers"),
        ("rational", [0, 0, 0, 0, 0, -9.0, 0, 0], "the lens shows 6% of its pinhole view: check the coefficients'"),
        ("equidistant", [-3.0, 0.0, 0.0, 0.0], "folds over within the image"),
        ("equidistant", [0.1, 0.2], "equidistant has k1, k2, k3, k4, found 2 numbers"),
        ("fov", [0.0], "omega of the fov lens is an angle"),
        ("fov", [9.0], "omega of the fov lens is an angle"),
    ],
)
def test_models_that_mean_nothing_are_refused(model, coefficients, said):
    with pytest.raises(GeometryError, match=said):
        undistorted(RAW, np.array(coefficients, float), model)


@pytest.mark.parametrize(("model", "coefficients"), [("radtan", RADTAN), *LENSES])
def test_camera_yaml_takes_each_lens_and_writes_it_back(model, coefficients, tmp_path, rng):
    lens, said = undistorted(RAW, coefficients, model)
    image = rng.integers(0, 256, (RAW.height, RAW.width, 3), dtype=np.uint8)
    folder = write_sequence_folder(tmp_path / "s", RAW, np.zeros(1), images=[image], distortion=lens)
    recording = open_sequence(folder)
    assert (recording.raw_camera, recording.camera, recording.distortion.model) == (RAW, lens.camera, model)
    assert np.array_equal(recording.distortion.coefficients, coefficients)
    assert np.array_equal(recording.read_image(0), lens.undistort_image(image))
    assert [note for note in recording.notes if "pinhole view" in note] == (
        [f"{folder / 'camera.yaml'}: distortion_model: {said}"] if said else []
    )


CAMERA_PROBLEMS = [
    ({"distortion_model": "equidistant", "distortion_coeffs": [0.1]}, "distortion_coeffs: equidistant has k1, k2, k3"),
    ({"distortion_model": "fov"}, "distortion_coeffs: fov has omega, found 0 numbers"),
    ({"distortion_model": "rational", "distortion_coeffs": [0.1] * 4}, "distortion_coeffs: rational has k1, k2, p1"),
    ({"distortion_model": "equidistant", "distortion_coeffs": [-9.0, 0, 0, 0]}, "distortion_coeffs: the distortion f"),
    ({"distortion_model": "equidistant", "distortion_coeffs": [1e29] * 4}, "distortion_coeffs: the lens shows 0% of"),
    ({"distortion_model": ["radtan"]}, "distortion_model: expected none, radtan"),
]


@pytest.mark.parametrize(("changes", "message"), CAMERA_PROBLEMS)
def test_camera_problems_name_their_key(folder, changes, message, expect_problem):
    edit_yaml(folder / "camera.yaml", **changes)
    expect_problem(folder, f"camera.yaml: {message}")
