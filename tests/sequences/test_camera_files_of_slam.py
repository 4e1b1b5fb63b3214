"""Calibrations of SLAM systems: ORB-SLAM2 and 3, VINS, Kalibr's chains, Basalt; as they write them, and damaged."""

import json

import numpy as np
import pytest
import yaml

from meshslam.errors import SequenceError
from meshslam.geometry import Pose
from meshslam.sequences import Report, read_camera, read_extrinsics
from tests.sequences.test_camera_files import FISHEYE, RADTAN, RATIONAL, TURNED, K, expect, kalibr, matrix, written

# ORB-SLAM ------------------------------------------------------------------------------------------------------------

OPENCV_MATRIX = "!!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: f\n   data: [{data}]\n"


def opencv_matrix(array):
    array = np.atleast_2d(array)
    numbers = ", ".join(map(str, array.ravel().tolist()))
    return OPENCV_MATRIX.format(rows=array.shape[0], cols=array.shape[1], data=numbers)


def orb_slam_3(kind="PinHole", group="Camera1", lens=("k1", "k2", "p1", "p2"), values=RADTAN, more=""):
    rows = [f"{group}.{key}: {value!r}" for key, value in zip(lens, values, strict=True)]
    named = zip(("fx", "fy", "cx", "cy"), (458.654, 457.296, 367.215, 248.375), strict=True)
    intrinsics = [f"{group}.{key}: {value}" for key, value in named]
    head = ["%YAML:1.0", "", "#----------", 'File.version: "1.0"', "", f'Camera.type: "{kind}"', "# lens"]
    tail = ["", "Camera.width: 752", "Camera.height: 480", "Camera.newWidth: 600", "Camera.newHeight: 350"]
    tail += ["", "Camera.fps: 20", "Camera.RGB: 1", "", "IMU.NoiseGyro: 1.7e-4", "IMU.Frequency: 200.0", ""]
    orb = ["ORBextractor.nFeatures: 1000", "ORBextractor.scaleFactor: 1.2", "Viewer.ViewpointF: 500.0"]
    return "\n".join([*head, *intrinsics, *rows, *tail, more, *orb]) + "\n"


def orb_slam_2(size=True, lens=RADTAN):
    keys = ("k1", "k2", "p1", "p2", "k3")
    rows = [f"Camera.{key}: {value!r}" for key, value in zip(keys, lens, strict=False)]
    rows = ["Camera.fx: 458.654", "Camera.fy: 457.296", "Camera.cx: 367.215", "Camera.cy: 248.375", "", *rows]
    sizes = ["Camera.width: 752", "Camera.height: 480"] if size else []
    return "\n".join(["%YAML:1.0", "", *rows, *sizes, "Camera.fps: 30.0", "Camera.bf: 47.9", "ThDepth: 35", ""])


def test_orb_slam_3(tmp_path):
    mounted = f"IMU.T_b_c1: {opencv_matrix(TURNED.matrix)}"
    found = read_camera(written(tmp_path, orb_slam_3(more=mounted)))
    expect(found, "radtan", RADTAN)
    assert np.allclose(found.imu_from_camera.matrix, TURNED.matrix, atol=1e-6)
    wide = orb_slam_3("KannalaBrandt8", lens=("k1", "k2", "k3", "k4"), values=FISHEYE)
    found = read_camera(written(tmp_path, wide))
    expect(found, "equidistant", FISHEYE)
    assert found.imu_from_camera is None
    five = orb_slam_3(lens=("k1", "k2", "p1", "p2", "k3"), values=[*RADTAN, 0.02])
    expect(read_camera(written(tmp_path, five)), "radtan", [*RADTAN, 0.02])
    expect(read_camera(written(tmp_path, orb_slam_3("Rectified", lens=(), values=()))), "none", [])


def test_the_right_camera_of_orb_slam_3(tmp_path, rng):
    baseline = Pose.from_yaw(0.01, np.array([0.11, 0.001, 0.0]))
    second = "\n".join(f"Camera2.{k}: {v}" for k, v in {"fx": 457.0, "fy": 456.0, "cx": 379.9, "cy": 255.2}.items())
    lens = "\n".join(f"Camera2.{k}: {v}" for k, v in zip(("k1", "k2", "p1", "p2"), RADTAN, strict=True))
    stereo = f"Stereo.T_c1_c2: {opencv_matrix(baseline.matrix)}IMU.T_b_c1: {opencv_matrix(TURNED.matrix)}"
    path = written(tmp_path, orb_slam_3(more=f"{second}\n{lens}\n{stereo}"))
    with pytest.raises(SequenceError, match=r"choose one by its number, --camera N: 1 \(Camera1\), 2 \(Camera2\)"):
        read_camera(path)
    found = read_camera(path, 2)
    assert found.distortion.raw_camera.cx == 379.9
    assert np.allclose(found.imu_from_camera.matrix, (TURNED @ baseline).matrix, atol=1e-6)
    expect(read_camera(path, 1), "radtan", RADTAN)


def test_orb_slam_2(tmp_path):
    expect(read_camera(written(tmp_path, orb_slam_2())), "radtan", RADTAN)
    expect(read_camera(written(tmp_path, orb_slam_2(size=False)), size=(752, 480)), "radtan", RADTAN)
    with pytest.raises(SequenceError, match="does not say of which image size it is: give --size"):
        read_camera(written(tmp_path, orb_slam_2(size=False)))
    expect(read_camera(written(tmp_path, orb_slam_2(lens=[0.0] * 4))), "none", [])


def test_stereo_files_of_orb_slam_2_give_the_raw_cameras(tmp_path):
    raw = f"LEFT.height: 480\nLEFT.width: 752\nLEFT.D: {opencv_matrix([*RADTAN, 0.0])}LEFT.K: {opencv_matrix(K)}"
    found = read_camera(written(tmp_path, orb_slam_2(lens=[0.0] * 4) + raw))
    expect(found, "radtan", [*RADTAN, 0.0])


ORB_WRONG = {
    "model": (orb_slam_3("OmniDirectional"), "Camera.type: expected PinHole, KannalaBrandt8 or Rectified, found 'Omni"),
    "coefficient": (orb_slam_3("KannalaBrandt8", lens=("k1", "k2"), values=FISHEYE[:2]), "Camera1.k3: key is missing"),
    "focal": (orb_slam_3().replace("Camera1.fy: 457.296", ""), "Camera1.fy: key is missing"),
    "word": (orb_slam_3().replace("457.296", "far"), "Camera1.fy: expected numbers, found 'far'"),
    "height": (orb_slam_3().replace("Camera.height: 480", ""), "Camera.height: key is missing"),
    "mounting": (
        orb_slam_3(more=f"IMU.T_b_c1: {opencv_matrix(2 * np.eye(4))}"),
        "IMU.T_b_c1: a pose's rotation must be orthonormal",
    ),
    "rows": (orb_slam_3(more=f"IMU.T_b_c1: {opencv_matrix(np.eye(3))}"), "IMU.T_b_c1: expected a 4x4 matrix"),
}


@pytest.mark.parametrize("case", ORB_WRONG)
def test_wrong_orb_slam_settings_are_one_line(tmp_path, case):
    text, said = ORB_WRONG[case]
    with pytest.raises(SequenceError) as caught:
        read_camera(written(tmp_path, text))
    assert said in str(caught.value)


# VINS -----------------------------------------------------------------------------------------------------------------


def vins_camera(**changes):
    lens = dict(zip(("k1", "k2", "p1", "p2"), RADTAN, strict=True))
    projection = {"fx": 458.654, "fy": 457.296, "cx": 367.215, "cy": 248.375}
    content = {"model_type": "PINHOLE", "camera_name": "camera", "image_width": 752, "image_height": 480}
    content |= {"distortion_parameters": lens, "projection_parameters": projection}
    return "%YAML:1.0\n---\n" + yaml.safe_dump(content | changes, sort_keys=False)


def vins_fusion(more="", count=2):
    cameras = "".join(f'cam{n}_calib: "cam{n}.yaml"\n' for n in range(count))
    poses = "".join(f"body_T_cam{n}: {opencv_matrix((TURNED @ SHIFTED[n]).matrix)}" for n in range(count))
    head = "%YAML:1.0\n\n#common parameters\nimu: 1\n"
    topics = 'imu_topic: "/imu0"\nimage0_topic: "/cam0/image_raw"\noutput_path: "~/output"\n'
    rest = "image_width: 752\nimage_height: 480\nestimate_extrinsic: 0\n"
    return f"{head}num_of_cam: {count}\n{topics}{cameras}{rest}{poses}max_cnt: 150\ng_norm: 9.81\n{more}"


SHIFTED = (Pose.identity(), Pose.from_yaw(0.0, np.array([0.1, 0.0, 0.0])))


def test_vins_fusion(tmp_path):
    path = written(tmp_path, vins_fusion(), "euroc_stereo_imu_config.yaml")
    written(tmp_path, vins_camera(), "cam0.yaml")
    written(tmp_path, vins_camera(image_height=400), "cam1.yaml")
    with pytest.raises(SequenceError, match=r"0 \(cam0_calib\), 1 \(cam1_calib\)"):
        read_camera(path)
    found = read_camera(path, 0)
    expect(found, "radtan", RADTAN)
    assert np.allclose(found.imu_from_camera.matrix, TURNED.matrix, atol=1e-6)
    other = read_camera(path, 1)
    assert other.camera.height == 400
    assert np.allclose(other.imu_from_camera.matrix, (TURNED @ SHIFTED[1]).matrix, atol=1e-6)


def test_what_vins_is_not_certain_of_is_said(tmp_path):
    report = Report()
    text = vins_fusion("estimate_td: 1\ntd: 0.012\n", count=1).replace("extrinsic: 0", "extrinsic: 1")
    written(tmp_path, vins_camera(), "cam0.yaml")
    path = written(tmp_path, text, "config.yaml")
    read_camera(path, report=report)
    assert any("estimate_extrinsic: is 1: the mounting is a first guess" in note for note in report.notes)
    assert any("td: the clocks' offset is no part of a camera" in note for note in report.notes)
    assert read_extrinsics(path)[1] == 0.012


def test_a_vins_configuration_without_its_cameras_is_one_line(tmp_path):
    path = written(tmp_path, vins_fusion(count=1), "config.yaml")
    with pytest.raises(SequenceError, match=r"cam0_calib: names 'cam0.yaml', which is not there: put it beside"):
        read_camera(path)
    written(tmp_path, "%YAML:1.0\n---\nfx: 1.0\n", "cam0.yaml")
    with pytest.raises(SequenceError, match=r"cam0.yaml: model_type: key is missing"):
        read_camera(path)


def test_vins_mono_has_all_in_one_file(tmp_path):
    matrices = f"extrinsicRotation: {opencv_matrix(TURNED.rotation)}"
    matrices += f"extrinsicTranslation: {opencv_matrix(TURNED.translation[:, None])}"
    text = 'imu_topic: "/imu0"\n' + vins_camera().partition("---\n")[2] + f"estimate_extrinsic: 0\n{matrices}"
    found = read_camera(written(tmp_path, "%YAML:1.0\n" + text))
    expect(found, "radtan", RADTAN)
    assert np.allclose(found.imu_from_camera.matrix, TURNED.matrix, atol=1e-6)
    unknown = text.replace("estimate_extrinsic: 0", "estimate_extrinsic: 2")
    assert read_camera(written(tmp_path, "%YAML:1.0\n" + unknown)).imu_from_camera is None


# Kalibr's chains ------------------------------------------------------------------------------------------------------


def chain(known=0, count=3):
    """Cameras of which one has T_cam_imu alone; each has T_cn_cnm1 of the one before it."""
    steps = [Pose.from_yaw(0.1 * n, np.array([-0.1, 0.02 * n, 0.01])) for n in range(count)]
    poses = [TURNED]
    for step in steps[1:]:
        poses.append(step @ poses[-1])
    drop = {"T_cam_imu": "drop"}
    cameras = {
        f"cam{n}": kalibr(**(drop if n != known else {"T_cam_imu": poses[n].matrix.tolist()})) for n in range(count)
    }
    for n in range(1, count):
        cameras[f"cam{n}"]["T_cn_cnm1"] = steps[n].matrix.tolist()
    return cameras, poses


@pytest.mark.parametrize("known", [0, 1, 2])
def test_the_mounting_of_a_camera_is_composed_along_kalibrs_chain(tmp_path, known):
    cameras, poses = chain(known)
    path = written(tmp_path, cameras)
    for n in range(3):
        report = Report()
        found = read_camera(path, n, report=report)
        assert np.allclose(found.imu_from_camera.matrix, poses[n].inverse().matrix)
        assert np.allclose(read_extrinsics(path, n)[0].matrix, poses[n].inverse().matrix)
        assert (n == known) == (not any("is composed of that of" in note for note in report.notes))


def test_a_chain_that_is_broken_gives_no_mounting(tmp_path):
    cameras, _ = chain()
    del cameras["cam1"]["T_cn_cnm1"]
    path = written(tmp_path, cameras)
    assert read_camera(path, 2).imu_from_camera is None
    with pytest.raises(SequenceError, match="cam2: expected T_cam_imu"):
        read_extrinsics(path, 2)
    cameras["cam1"]["T_cn_cnm1"] = (2 * np.eye(4)).tolist()
    with pytest.raises(SequenceError, match="cam1: T_cn_cnm1: "):
        read_camera(written(tmp_path, cameras), 2)


def test_the_clock_of_a_composed_camera_is_that_of_the_one_it_comes_from(tmp_path):
    cameras, _ = chain()
    cameras["cam0"]["timeshift_cam_imu"] = 0.02
    assert read_extrinsics(written(tmp_path, cameras), 2)[1] == 0.02


# Basalt ---------------------------------------------------------------------------------------------------------------


def basalt(kind="kb4", keys=("k1", "k2", "k3", "k4"), values=FISHEYE, **changes):
    qx, qy, qz, qw = TURNED.to_quaternion(order="xyzw")
    pose = dict(zip(("px", "py", "pz", "qx", "qy", "qz", "qw"), (*TURNED.translation, qx, qy, qz, qw), strict=True))
    lens = {"fx": 458.654, "fy": 457.296, "cx": 367.215, "cy": 248.375, **dict(zip(keys, values, strict=True))}
    inner = {
        "T_imu_cam": [pose],
        "intrinsics": [{"camera_type": kind, "intrinsics": lens}],
        "resolution": [[752, 480]],
        "calib_accel_bias": [0.0] * 9,
        "imu_update_rate": 200.0,
        "cam_time_offset_ns": 0,
        "vignette": [],
    }
    return json.dumps({"value0": inner | changes}, indent=4)


def test_basalt(tmp_path):
    found = read_camera(written(tmp_path, basalt(), "calib.json"))
    expect(found, "equidistant", FISHEYE)
    assert np.allclose(found.imu_from_camera.matrix, TURNED.matrix)
    keys = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    expect(read_camera(written(tmp_path, basalt("pinhole-radtan8", keys, RATIONAL))), "rational", RATIONAL)
    expect(read_camera(written(tmp_path, basalt("pinhole", (), ()))), "none", [])
    path = written(tmp_path, basalt(cam_time_offset_ns=5_000_000))
    pose, ahead_s = read_extrinsics(path)
    assert ahead_s == pytest.approx(0.005)
    assert np.allclose(pose.matrix, TURNED.matrix)


BASALT_WRONG = {
    "model": (
        basalt("ds", ("xi", "alpha"), (0.1, 0.5)),
        "intrinsics 0: camera_type: 'ds' is not read, only pinhole, pin",
    ),
    "coefficient": (basalt(keys=("k1",), values=FISHEYE[:1]), "intrinsics 0: k2: key is missing"),
    "list": (basalt(intrinsics=[3]), "intrinsics 0: camera_type: key is missing"),
    "no dictionary": (basalt(intrinsics=[{"camera_type": "kb4", "intrinsics": [1, 2]}]), "expected the keys fx, fy"),
    "pose": (basalt(T_imu_cam=[[1, 2]]), "T_imu_cam 0: expected the keys px, py"),
    "quaternion": (
        basalt(T_imu_cam=[dict.fromkeys(("px", "py", "pz", "qx", "qy", "qz", "qw"), 0)]),
        "T_imu_cam 0: a quaternion's length",
    ),
    "size": (basalt(resolution=[[752]]), "resolution 0: expected [width, height]"),
}


@pytest.mark.parametrize("case", BASALT_WRONG)
def test_wrong_basalt_files_are_one_line(tmp_path, case):
    text, said = BASALT_WRONG[case]
    with pytest.raises(SequenceError) as caught:
        read_camera(written(tmp_path, text))
    assert said in str(caught.value)


# mountings ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        orb_slam_3(more=f"IMU.T_b_c1: {opencv_matrix(TURNED.matrix)}"),
        orb_slam_2() + f"Tbc: {opencv_matrix(TURNED.matrix)}",
        basalt(),
        yaml.safe_dump({"sensor_type": "camera", "T_BS": matrix(TURNED.matrix), "intrinsics": [458.0, 457, 367, 248]}),
    ],
    ids=["ORB-SLAM3", "ORB-SLAM2", "Basalt", "EuRoC"],
)
def test_a_calibration_with_a_mounting_is_an_extrinsics_file(tmp_path, text):
    pose, ahead_s = read_extrinsics(written(tmp_path, text))
    assert np.allclose(pose.matrix, TURNED.matrix, atol=1e-6)
    assert ahead_s == 0.0


def test_a_calibration_without_a_mounting_is_no_extrinsics_file(tmp_path):
    with pytest.raises(SequenceError, match="ORB-SLAM settings: says nothing of how the IMU is mounted"):
        read_extrinsics(written(tmp_path, orb_slam_3()))
