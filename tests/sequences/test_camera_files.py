"""Calibration files of other tools: as their own writers write them, and with something missing, odd or damaged."""

import json
import struct

import cv2
import numpy as np
import pytest
import yaml

from meshslam.errors import SequenceError
from meshslam.geometry import Camera, Pose
from meshslam.sequences import Report, camera_yaml, read_camera, undistorted
from tests.sequences.test_damaged_files import withstands  # noqa: F401 # a fixture

K = np.array([[458.654, 0.0, 367.215], [0.0, 457.296, 248.375], [0.0, 0.0, 1.0]])
CAMERA = Camera(752, 480, 458.654, 457.296, 367.215, 248.375)
RADTAN = [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
RATIONAL = [0.9, 0.3, 0.0005, -0.0003, 0.01, 1.25, 0.5, 0.05]
FISHEYE = [-0.0028, 0.0045, -0.0031, 0.0006]
TURNED = Pose.from_yaw(0.3, np.array([0.1, -0.2, 0.3]))


def lens_of(found):
    return "none" if found.distortion is None else found.distortion.model


def expect(found, model, coefficients):
    raw = found.camera if found.distortion is None else found.distortion.raw_camera
    assert raw == CAMERA
    assert lens_of(found) == model
    assert found.distortion is None or np.allclose(found.distortion.coefficients, coefficients)


def written(tmp_path, content, name="calibration.yaml"):
    path = tmp_path / name
    path.write_text(content if isinstance(content, str) else yaml.safe_dump(content, default_flow_style=None))
    return path


# Kalibr ---------------------------------------------------------------------------------------------------------------


def kalibr(**changes):
    camera = {
        "camera_model": "pinhole",
        "cam_overlaps": [1],
        "intrinsics": [458.654, 457.296, 367.215, 248.375],
        "distortion_model": "radtan",
        "distortion_coeffs": RADTAN,
        "resolution": [752, 480],
        "rostopic": "/cam0/image_raw",
        "T_cam_imu": TURNED.matrix.tolist(),
        "timeshift_cam_imu": 0.0,
    }
    return {k: v for k, v in (camera | changes).items() if v != "drop"}


def test_kalibr(tmp_path):
    found = read_camera(written(tmp_path, {"cam0": kalibr()}))
    expect(found, "radtan", RADTAN)
    assert np.allclose(found.imu_from_camera.matrix, TURNED.inverse().matrix)
    fisheye = kalibr(distortion_model="equidistant", distortion_coeffs=FISHEYE, T_cam_imu="drop")
    found = read_camera(written(tmp_path, {"cam0": kalibr(), "cam1": fisheye}), 1)
    expect(found, "equidistant", FISHEYE)
    assert found.imu_from_camera is None
    expect(read_camera(written(tmp_path, {"cam0": kalibr(distortion_model="none", distortion_coeffs=[])})), "none", [])


def test_of_several_cameras_none_is_taken_in_silence(tmp_path):
    path = written(tmp_path, {"cam0": kalibr(), "cam1": kalibr(resolution=[640, 480])})
    with pytest.raises(
        SequenceError, match=r"holds 2 cameras: choose one by its number, --camera N: 0 \(cam0\), 1 \(cam1\)"
    ):
        read_camera(path)
    with pytest.raises(SequenceError, match=r"holds no camera 2, only 0 \(cam0\), 1 \(cam1\)"):
        read_camera(path, 2)
    assert read_camera(path, 1).camera.width == 640


def test_a_clock_offset_is_said(tmp_path):
    report = Report()
    read_camera(written(tmp_path, {"cam0": kalibr(timeshift_cam_imu=0.01)}), report=report)
    assert "cam0: timeshift_cam_imu: the clocks' offset is no part of a camera" in report.notes[0]


# ROS ------------------------------------------------------------------------------------------------------------------


def matrix(values):
    array = np.atleast_2d(values)
    return {"rows": array.shape[0], "cols": array.shape[1], "data": array.ravel().tolist()}


def ros(model="plumb_bob", coefficients=(*RADTAN, 0.0), **changes):
    camera = {
        "image_width": 752,
        "image_height": 480,
        "camera_name": "left",
        "camera_matrix": matrix(K),
        "distortion_model": model,
        "distortion_coefficients": matrix(coefficients),
        "rectification_matrix": matrix(np.eye(3)),
        "projection_matrix": matrix(np.zeros((3, 4))),
    }
    return {k: v for k, v in (camera | changes).items() if v != "drop"}


def test_ros_camera_info(tmp_path):
    expect(read_camera(written(tmp_path, ros())), "radtan", [*RADTAN, 0.0])
    expect(read_camera(written(tmp_path, ros("plumb_bob", [0.0] * 5))), "none", [])
    expect(read_camera(written(tmp_path, ros("rational_polynomial", RATIONAL))), "rational", RATIONAL)
    expect(read_camera(written(tmp_path, ros("rational_polynomial", [*RATIONAL, *[0.0] * 6]))), "rational", RATIONAL)
    expect(read_camera(written(tmp_path, ros("equidistant", FISHEYE))), "equidistant", FISHEYE)


@pytest.mark.parametrize("names", ["KD", "kd"])
def test_a_printed_message_is_read(names, tmp_path):
    text = (
        "header:\n  stamp:\n    sec: 1\n  frame_id: cam\nheight: 480\nwidth: 752\ndistortion_model: plumb_bob\n"
        f"{names[1]}: {RADTAN}\n{names[0]}: {K.ravel().tolist()}\nbinning_x: 0\n---\n"
    )
    expect(read_camera(written(tmp_path, text)), "radtan", RADTAN)


# OpenCV ---------------------------------------------------------------------------------------------------------------


def storage(path, **content):
    writer = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for key, value in content.items():
        writer.write(key, value)
    writer.release()
    return path


OPENCV = {"image_width": 752, "image_height": 480, "camera_matrix": K}


@pytest.mark.parametrize("end", ["yml", "yaml", "xml", "json"])
def test_opencv_storage(end, tmp_path):
    path = storage(tmp_path / f"a.{end}", **OPENCV, distortion_coefficients=np.array([[*RADTAN, 0.01]]).T)
    expect(read_camera(path), "radtan", [*RADTAN, 0.01])
    path = storage(tmp_path / f"b.{end}", imageSize=np.array([752, 480]), cameraMatrix=K, distCoeffs=np.array(RATIONAL))
    expect(read_camera(path), "rational", RATIONAL)
    path = storage(tmp_path / f"c.{end}", **OPENCV, distortion_coefficients=np.array(FISHEYE), fisheye_model=1)
    expect(read_camera(path), "equidistant", FISHEYE)
    path = storage(tmp_path / f"d.{end}", K=K, D=np.array([*RATIONAL, *[0.0] * 6]))
    expect(read_camera(path, size=(752, 480)), "rational", RATIONAL)


def test_the_storage_of_opencv_4_is_read(tmp_path):
    text = storage(tmp_path / "new.yml", **OPENCV, D=np.array(RADTAN)).read_text()
    for header in ("%YAML:1.0\n---", "%YAML 1.2\n---"):
        old = written(tmp_path, header + text.partition("---")[2], "old.yml")
        expect(read_camera(old), "radtan", RADTAN)


def test_four_numbers_without_a_name_are_said_to_be_radtan(tmp_path):
    report = Report()
    read_camera(storage(tmp_path / "a.yml", **OPENCV, D=np.array(RADTAN)), report=report)
    assert "four coefficients are read as k1, k2, p1, p2; those of cv2.fisheye need fisheye_model: 1" in report.notes[0]


def test_a_stereo_file_of_opencv_has_two_cameras(tmp_path):
    path = storage(tmp_path / "s.yml", M1=K, D1=np.array(RADTAN), M2=2 * K - np.diag([0, 0, 1.0]), D2=np.zeros(5))
    expect(read_camera(path, 1, (752, 480)), "radtan", RADTAN)
    assert read_camera(path, 2, (1504, 960)).camera.fx == 2 * 458.654
    with pytest.raises(SequenceError, match=r"choose one by its number, --camera N: 1 \(M1\), 2 \(M2\)"):
        read_camera(path, size=(752, 480))


def test_thin_prism_and_tilt_are_refused(tmp_path):
    path = storage(tmp_path / "a.yml", **OPENCV, D=np.array([*RATIONAL, 0.01, 0.0, 0.0, 0.0]))
    with pytest.raises(SequenceError, match="D: rational has k1, k2, p1, p2, k3, k4, k5, k6, found 12 numbers"):
        read_camera(path)


# EuRoC, camodocal, KITTI ----------------------------------------------------------------------------------------------


def euroc(**changes):
    camera = {
        "sensor_type": "camera",
        "comment": "VI-Sensor cam0",
        "T_BS": {"cols": 4, "rows": 4, "data": TURNED.matrix.ravel().tolist()},
        "rate_hz": 20,
        "resolution": [752, 480],
        "camera_model": "pinhole",
        "intrinsics": [458.654, 457.296, 367.215, 248.375],
        "distortion_model": "radial-tangential",
        "distortion_coefficients": RADTAN,
    }
    return {k: v for k, v in (camera | changes).items() if v != "drop"}


def test_euroc(tmp_path):
    found = read_camera(written(tmp_path, euroc()))
    expect(found, "radtan", RADTAN)
    assert np.allclose(found.imu_from_camera.matrix, TURNED.matrix)
    found = read_camera(written(tmp_path, euroc(distortion_model="equidistant", distortion_coefficients=FISHEYE)))
    expect(found, "equidistant", FISHEYE)


def camodocal(**changes):
    pinhole = {"fx": 458.654, "fy": 457.296, "cx": 367.215, "cy": 248.375}
    bent = dict(zip(("k1", "k2", "p1", "p2"), RADTAN, strict=True))
    camera = {"model_type": "PINHOLE", "camera_name": "camera", "image_width": 752, "image_height": 480}
    return {**camera, "distortion_parameters": bent, "projection_parameters": pinhole, **changes}


def test_camodocal(tmp_path):
    text = yaml.safe_dump(camodocal())
    expect(read_camera(written(tmp_path, f"%YAML:1.0\n---\n{text}")), "radtan", RADTAN)
    names = ("k2", "k3", "k4", "k5", "mu", "mv", "u0", "v0")
    values = dict(zip(names, [*FISHEYE, 458.654, 457.296, 367.215, 248.375], strict=True))
    path = written(tmp_path, camodocal(model_type="KANNALA_BRANDT", projection_parameters=values))
    expect(read_camera(path), "equidistant", FISHEYE)


def test_the_mirror_model_of_kitti_360_is_refused(tmp_path):
    path = written(tmp_path, camodocal(model_type="MEI", mirror_parameters={"xi": 2.2}))
    with pytest.raises(SequenceError, match="model_type: 'MEI' is not read"):
        read_camera(path)


KITTI = (
    "calib_time: 09-Jan-2012 13:57:47\ncorner_dist: 9.950000e-02\nS_00: 1.392000e+03 5.120000e+02\n"
    "S_rect_00: 1.408000e+03 3.760000e+02\nR_rect_00: 1 0 0 0 1 0 0 0 1\n"
    "P_rect_00: 5.525540e+02 0.0 6.820494e+02 0.0 0.0 5.525540e+02 2.387695e+02 0.0 0.0 0.0 1.0 0.0\n"
    "S_rect_01: 1.408000e+03 3.760000e+02\n"
    "P_rect_01: 5.525540e+02 0.0 6.820494e+02 -3.28e+02 0.0 5.525540e+02 2.387695e+02 0.0 0.0 0.0 1.0 0.0\n"
)


def test_kitti_360(tmp_path):
    path = written(tmp_path, KITTI, "perspective.txt")
    found = read_camera(path, 1)
    assert (found.camera, found.distortion) == (Camera(1408, 376, 552.554, 552.554, 682.0494, 238.7695), None)
    with pytest.raises(SequenceError, match=r"choose one by its number, --camera N: 0 \(P_rect_00\), 1 \(P_rect_01\)"):
        read_camera(path)


# COLMAP ---------------------------------------------------------------------------------------------------------------

ROWS = [  # as pycolmap writes them, which agrees with us to 1e-12 px
    (0, "SIMPLE_PINHOLE", [458.654, 367.715, 248.875], "none", []),
    (1, "PINHOLE", [458.654, 457.296, 367.715, 248.875], "none", []),
    (2, "SIMPLE_RADIAL", [458.654, 367.715, 248.875, -0.1], "radtan", [-0.1, 0, 0, 0]),
    (3, "RADIAL", [458.654, 367.715, 248.875, -0.1, 0.02], "radtan", [-0.1, 0.02, 0, 0]),
    (4, "OPENCV", [458.654, 457.296, 367.715, 248.875, *RADTAN], "radtan", RADTAN),
    (5, "OPENCV_FISHEYE", [458.654, 457.296, 367.715, 248.875, *FISHEYE], "equidistant", FISHEYE),
    (6, "FULL_OPENCV", [458.654, 457.296, 367.715, 248.875, *RATIONAL], "rational", RATIONAL),
    (7, "FOV", [458.654, 457.296, 367.715, 248.875, 0.93], "fov", [0.93]),
    (8, "SIMPLE_RADIAL_FISHEYE", [458.654, 367.715, 248.875, -0.02], "equidistant", [-0.02, 0, 0, 0]),
    (
        10,
        "THIN_PRISM_FISHEYE",
        [458.654, 457.296, 367.715, 248.875, *FISHEYE[:2], 0, 0, *FISHEYE[2:], 0, 0],
        "equidistant",
        FISHEYE,
    ),
    (14, "SIMPLE_FISHEYE", [458.654, 367.715, 248.875], "equidistant", [0, 0, 0, 0]),
    (15, "FISHEYE", [458.654, 457.296, 367.715, 248.875], "equidistant", [0, 0, 0, 0]),
    (9, "RADIAL_FISHEYE", [458.654, 367.715, 248.875, -0.02, 0.003], "equidistant", [-0.02, 0.003, 0, 0]),
]
HEADER = "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"


def colmap_text(rows=ROWS):
    lines = [f"{n + 1} {name} 752 480 {' '.join(map(repr, values))}\n" for n, name, values, _, _ in rows]
    return f"{HEADER}# Number of cameras: {len(rows)}\n" + "".join(lines)


def colmap_binary(rows=ROWS):
    cameras = [struct.pack(f"<iiQQ{len(v)}d", n + 1, n, 752, 480, *v) for n, _, v, _, _ in rows]
    return struct.pack("<Q", len(rows)) + b"".join(cameras)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[1])
def test_colmap(row, tmp_path):
    number, _, values, model, coefficients = row
    text, binary = written(tmp_path, colmap_text(), "cameras.txt"), tmp_path / "cameras.bin"
    binary.write_bytes(colmap_binary())
    for path in (text, binary):
        found = read_camera(path, number + 1)
        raw = found.camera if found.distortion is None else found.distortion.raw_camera
        assert np.allclose([raw.fx, raw.cx, raw.cy], [458.654, 367.215, 248.375])  # half a pixel from COLMAP's
        assert raw.fy == (457.296 if 457.296 in values else raw.fx)
        assert lens_of(found) == model
        assert found.distortion is None or np.allclose(found.distortion.coefficients, coefficients)


def test_one_camera_of_colmap_is_taken_without_a_number(tmp_path):
    path = tmp_path / "cameras.bin"
    path.write_bytes(colmap_binary(ROWS[4:5]))
    expect(read_camera(path), "radtan", RADTAN)


# sizes ----------------------------------------------------------------------------------------------------------------


def test_intrinsics_of_another_size_are_scaled(tmp_path, rng):
    path, report = written(tmp_path, {"cam0": kalibr()}), Report()
    half = read_camera(path, size=(376, 240), report=report)
    whole = read_camera(path)
    pixels = rng.uniform([0, 0], [751, 479], (50, 2))
    assert np.allclose(
        half.distortion.undistort((pixels + 0.5) / 2 - 0.5), (whole.distortion.undistort(pixels) + 0.5) / 2 - 0.5
    )
    assert report.notes == (f"{path}: intrinsics of 752x480 are scaled to images of 376x240",)
    assert read_camera(path, size=(752, 480)).camera == whole.camera
    assert np.allclose(half.imu_from_camera.matrix, whole.imu_from_camera.matrix)


@pytest.mark.parametrize("size", [(480, 752), (752, 240), (640, 480), (0, 0), (-752, -480)])
def test_another_aspect_is_refused(size, tmp_path):
    with pytest.raises(SequenceError, match=r"is of images of 752x480, which do not scale to .*give --size"):
        read_camera(written(tmp_path, {"cam0": kalibr()}), size=size)


def test_a_file_without_a_size_needs_one(tmp_path):
    path = written(tmp_path, {"cam0": kalibr(resolution="drop")})
    with pytest.raises(SequenceError, match="does not say of which image size it is: give --size WIDTHxHEIGHT, px"):
        read_camera(path)
    expect(read_camera(path, size=(752, 480)), "radtan", RADTAN)


@pytest.mark.parametrize(("model", "coefficients"), [("radtan", RADTAN), ("equidistant", FISHEYE)])
def test_our_own_file_is_read_and_scaled(model, coefficients, tmp_path):
    lens, _ = undistorted(CAMERA, np.array(coefficients), model)
    path = written(tmp_path, camera_yaml(CAMERA, lens, TURNED, 1.5), "camera.yaml")
    report = Report()
    found = read_camera(path, report=report)
    expect(found, model, coefficients)
    assert (found.camera, found.height_above_ground_m) == (lens.camera, 1.5)
    assert np.allclose(found.imu_from_camera.matrix, TURNED.matrix)
    half = read_camera(path, size=(376, 240))
    assert (half.camera.width, half.distortion.raw_camera.fx) == (376, 458.654 / 2)
    assert half.height_above_ground_m == 1.5
    assert len(report.notes) == (model == "equidistant")


# odd twins ------------------------------------------------------------------------------------------------------------

SWAPPED = {"cam0": kalibr(intrinsics=[367.215, 248.375])}
ODD = {
    "kalibr without intrinsics": ({"cam0": kalibr(intrinsics="drop")}, "cam0: intrinsics: key is missing"),
    "kalibr with two": (SWAPPED, "cam0: intrinsics: expected 4 numbers, found 2"),
    "kalibr omni": ({"cam0": kalibr(camera_model="omni")}, "cam0: camera_model: expected pinhole, found 'omni'"),
    "kalibr ds": ({"cam0": kalibr(distortion_model="ds")}, "cam0: distortion_model: expected radtan, equidistant"),
    "kalibr with three": ({"cam0": kalibr(distortion_coeffs=RADTAN[:3])}, "cam0: distortion_coeffs: radtan has k1"),
    "kalibr half a pixel": ({"cam0": kalibr(resolution=[752.5, 480])}, "cam0: resolution: expected .width, height."),
    "kalibr of words": ({"cam0": kalibr(intrinsics="wide")}, "cam0: intrinsics: expected numbers, found 'wide'"),
    "kalibr mirrored": ({"cam0": kalibr(T_cam_imu=np.diag([1, 1, -1, 1.0]).tolist())}, "cam0: T_cam_imu: "),
    "kalibr negative": ({"cam0": kalibr(intrinsics=[-458, 457, 367, 248])}, "cam0: intrinsics: a camera's focal"),
    "ros without matrix": (ros(camera_matrix="drop"), "no known calibration file; known are our camera.yaml"),
    "ros without width": (ros(image_width="drop"), "width: key is missing"),
    "ros with eight": (ros(camera_matrix=matrix(K.ravel()[:8])), "camera_matrix: expected 9 numbers, found 8"),
    "ros transposed": (ros(camera_matrix=matrix(K.T)), "camera_matrix: expected .fx, skew, cx; 0, fy, cy; 0, 0, 1."),
    "ros unknown model": (ros("thin_prism"), "distortion_model: expected plumb_bob, rational_polynomial"),
    "ros fisheye with five": (ros("equidistant", [0.1] * 5), "distortion_coefficients: equidistant has k1, k2, k3, k4"),
    "ros binned": (ros(binning_x=2), "binning_x: binned images are of another size"),
    "euroc imu": ({"sensor_type": "imu", "T_BS": euroc()["T_BS"]}, "sensor_type: expected camera, found 'imu'"),
    "euroc without intrinsics": (euroc(intrinsics="drop"), "intrinsics: key is missing"),
    "euroc of nine": (euroc(T_BS={"cols": 3, "rows": 3, "data": [0.0] * 9}), "T_BS: expected a 4x4 matrix, found 9"),
    "camodocal without fx": (camodocal(projection_parameters={}), "projection_parameters: fx: key is missing"),
    "camodocal of a list": (camodocal(projection_parameters=[1]), "projection_parameters: expected the keys fx, fy"),
    "kitti short": (KITTI.replace(" 0.0 0.0 0.0 1.0 0.0", ""), "P_rect_00: expected 12 finite numbers"),
    "kitti without size": (KITTI.replace("S_rect_00", "S_rest_00"), "S_rect_00: key is missing, expected 2 numbers"),
    "colmap short": (HEADER + "1 PINHOLE 752 480 458 457\n", "line 3: PINHOLE has 4 finite parameters, found 2"),
    "colmap unknown": (
        HEADER + "1 EUCM 752 480 458 457 367 248 0.5 1\n",
        "line 3: the model EUCM is not read .make the project pinhole by colmap image_undistorter",
    ),
    "colmap thin prism": (
        HEADER + "1 THIN_PRISM_FISHEYE 752 480 458 457 367 248 0 0 0.1 0 0 0 0 0\n",
        "line 3: THIN_PRISM_FISHEYE is read where p1, p2, sx1, sy1 are zero alone",
    ),
    "colmap cut": (HEADER + "1 PINHOLE\n", "line 3: expected CAMERA_ID MODEL WIDTH HEIGHT PARAMETERS"),
    "colmap twice": (HEADER + "1 PINHOLE 7 4 4 5 3 2\n" * 2, "line 4: a second camera 1"),
    "colmap nan": (HEADER + "1 PINHOLE 752 480 nan 457 367 248\n", "line 3: PINHOLE has 4 finite parameters"),
    "images instead": ("1 0.9 0.1 0.1 0.1 0 0 0 1 a.png\n", "expected `key: value` lines"),
    "nothing": ("", "expected `key: value` lines"),
    "another yaml": ({"a": 1}, "no known calibration file; known are our camera.yaml, Kalibr's camchain"),
    "xml bomb": ('<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "c">]><opencv_storage/>', "DOCTYPE or entities"),
    "another xml": ("<svg></svg>", "expected <opencv_storage>, found <svg>"),
    "deep xml": ("<opencv_storage>" + "<a>" * 5000 + "</a>" * 5000 + "</opencv_storage>", "nested too deeply"),
    "cut xml": ("<opencv_storage><K>", "not valid XML"),
}


@pytest.mark.parametrize("name", ODD)
def test_what_is_odd_is_refused_in_one_line(name, tmp_path):
    content, said = ODD[name]
    path = written(tmp_path, content)
    with pytest.raises(SequenceError, match=said) as caught:
        read_camera(path, 0 if name.startswith("kitti") else None)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value).removeprefix(str(path))) <= 300


def test_paths_that_are_no_calibration_file(tmp_path):
    with pytest.raises(SequenceError, match=r"none.yaml: no such file"):
        read_camera(tmp_path / "none.yaml")
    with pytest.raises(SequenceError, match=r"cannot be read: Is a directory"):
        read_camera(tmp_path)
    with (tmp_path / "large.yaml").open("wb") as file:
        file.truncate(5 << 20)
    with pytest.raises(SequenceError, match=r"large.yaml: is 5 MB large: no calibration file"):
        read_camera(tmp_path / "large.yaml")
    (tmp_path / "cameras.bin").write_bytes(colmap_binary()[:-1])
    with pytest.raises(SequenceError, match=r"is cut: not all of its cameras are whole"):
        read_camera(tmp_path / "cameras.bin")


@pytest.mark.parametrize("kind", ["kalibr", "ros", "opencv.yml", "opencv.xml", "opencv.json", "euroc", "own", "colmap"])
def test_damaged_files(kind, tmp_path, withstands):  # noqa: F811
    small = {"image_width": 64, "image_height": 48, "camera_matrix": np.array([[60.0, 0, 31], [0, 61, 23], [0, 0, 1]])}
    row = {"resolution": [64, 48], "intrinsics": [60.0, 61.0, 31.0, 23.0]}
    if kind.startswith("opencv"):
        path = storage(tmp_path / kind, **small, D=np.array([*RADTAN, 0.01]))
    elif kind == "kalibr":
        path = written(tmp_path, {"cam0": kalibr(**row)})
    elif kind == "ros":
        path = written(
            tmp_path, ros("equidistant", FISHEYE, **small | {"camera_matrix": matrix(small["camera_matrix"])})
        )
    elif kind == "euroc":
        path = written(tmp_path, euroc(**row))
    elif kind == "own":
        path = written(tmp_path, {"model": "pinhole", "distortion_model": "fov", "distortion_coeffs": [0.9], **row})
    else:
        path = written(tmp_path, HEADER + "1 FULL_OPENCV 64 48 60 61 31 23 0.9 0.3 0.0005 -0.0003 0.01 1.25 0.5 0.05\n")
    withstands([path], lambda: read_camera(path))


def test_json_with_our_keys_is_read(tmp_path):
    path = written(tmp_path, json.dumps({"cam0": kalibr()}), "camchain.json")
    expect(read_camera(path), "radtan", RADTAN)
