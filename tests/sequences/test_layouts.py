"""Other data sets' folders: each gives the frames, times, camera and poses that were written into it."""

import json
import struct

import cv2
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from meshslam.errors import SequenceError
from meshslam.geometry import Pose
from meshslam.sequences import check_sequence, find_loader, format_tum, open_sequence
from tests.sequences.conftest import CAMERA, FRAMES, random_image

TIMES_S = 100.0 + 0.1 * np.arange(FRAMES)
STAMPS = [round(1e9 * t) for t in TIMES_S]
MOUNTED = Pose(Rotation.from_euler("xyz", [-90, 0, -90], degrees=True).as_matrix(), np.array([0.3, 0.1, 0.2]))


def levelled_path():
    """A camera that drives straight on, upright."""
    looking = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    return [Pose(looking, np.array([0.8 * i, 0.01 * i, 1.6])) for i in range(FRAMES)]


POSES = levelled_path()


def write_images(rng, folder, names):
    folder.mkdir(parents=True)
    images = [random_image(rng) for _ in names]
    for name, image in zip(names, images, strict=True):
        cv2.imwrite(str(folder / name), image)
    return images


def matrix(pose):
    return {"rows": 4, "cols": 4, "data": pose.matrix.ravel().tolist()}


def intrinsics():
    return [CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy]


def camera_file(folder):
    """Kalibr's camchain of the camera."""
    path = folder.parent / "camchain.yaml"
    entry = {"camera_model": "pinhole", "intrinsics": intrinsics(), "distortion_model": "none"}
    path.write_text(yaml.safe_dump({"cam0": entry | {"distortion_coeffs": [], "resolution": [64, 48]}}))
    return path


def euroc(folder, rng):
    root = folder / "mav0"
    names = [f"{stamp}.png" for stamp in STAMPS]
    images = write_images(rng, root / "cam0" / "data", names)
    rows = [f"{stamp},{name}" for stamp, name in zip(STAMPS, names, strict=True)]
    (root / "cam0" / "data.csv").write_text("\n".join(["#timestamp [ns],filename", *rows]))
    sensor = {"sensor_type": "camera", "T_BS": matrix(MOUNTED), "resolution": [64, 48], "camera_model": "pinhole"}
    sensor |= {"intrinsics": intrinsics(), "distortion_model": "radial-tangential"}
    (root / "cam0" / "sensor.yaml").write_text(yaml.safe_dump(sensor | {"distortion_coefficients": [0.0] * 4}))
    for name in ("imu0", "state_groundtruth_estimate0"):
        (root / name).mkdir()
        (root / name / "sensor.yaml").write_text(yaml.safe_dump({"T_BS": matrix(Pose.identity())}))
    samples = [f"{STAMPS[0] + 10_000_000 * k},0.1,0.2,0.3,0.0,0.0,9.81" for k in range(41)]
    (root / "imu0" / "data.csv").write_text("\n".join(["#timestamp [ns],w,w,w,a,a,a", *samples]))
    bodies = [pose @ MOUNTED.inverse() for pose in POSES]
    lines = [
        ",".join(map(str, [s, *p.translation, *p.to_quaternion(order="wxyz"), 0, 0, 0]))
        for s, p in zip(STAMPS, bodies, strict=True)
    ]
    (root / "state_groundtruth_estimate0" / "data.csv").write_text("\n".join(["#timestamp,p,q,v", *lines]))
    return images, {}


def tum_rgbd(folder, rng):
    names = [f"{t:.6f}.png" for t in TIMES_S]
    images = write_images(rng, folder / "rgb", names)
    rows = [f"{t:.6f} rgb/{name}" for t, name in zip(TIMES_S, names, strict=True)]
    (folder / "rgb.txt").write_text("\n".join(["# color images", *rows]))
    (folder / "groundtruth.txt").write_text("# ground truth\n" + format_tum(TIMES_S, POSES))
    return images, {"camera": camera_file(folder)}


def frames(folder, rng):
    images = write_images(rng, folder, [f"frame_{i}.png" for i in range(FRAMES)])
    poses = folder.parent / "poses.tum"
    poses.write_text(format_tum(TIMES_S - 100, POSES))
    return images, {"camera": camera_file(folder), "poses": poses}


def kitti_360(folder, rng):
    images = write_images(rng, folder / "image_00" / "data_rect", [f"{i:010d}.png" for i in range(FRAMES)])
    stamps = "".join(f"2013-05-28 08:46:{10 + 0.1 * i:012.9f}\n" for i in range(FRAMES))
    (folder / "image_00" / "timestamps.txt").write_text(stamps)
    home = folder.parent.parent
    (home / "calibration").mkdir()
    row = " ".join(map(str, np.column_stack([CAMERA.matrix, np.zeros(3)]).ravel()))
    turn = Rotation.from_rotvec([0.01, -0.02, 0.03]).as_matrix()  # rectified from raw
    text = f"S_rect_00: 64 48\nR_rect_00: {' '.join(map(str, turn.ravel()))}\nP_rect_00: {row}\n"
    (home / "calibration" / "perspective.txt").write_text(text)
    raw = (MOUNTED @ Pose(turn, np.zeros(3))).matrix[:3]
    (home / "calibration" / "calib_cam_to_pose.txt").write_text(f"image_00: {' '.join(map(str, raw.ravel()))}\n")
    poses = [(pose @ MOUNTED.inverse()).matrix[:3].ravel() for pose in POSES]
    lines = [" ".join(map(str, [i, *p])) for i, p in enumerate(poses) if i != 2]  # a gap
    (home / "data_poses" / folder.name).mkdir(parents=True)
    (home / "data_poses" / folder.name / "poses.txt").write_text("\n".join(lines))
    return images, {}


MADE = {"euroc": euroc, "tum-rgbd": tum_rgbd, "frames": frames, "kitti-360": kitti_360}


@pytest.fixture
def made(tmp_path, rng):
    def make(name):
        folder = tmp_path / "data" / "raw" / ("2013_05_28_drive_0000_sync" if name == "kitti-360" else "drive")
        folder.parent.mkdir(parents=True, exist_ok=True)
        images, options = MADE[name](folder, rng)
        return folder, images, options

    return make


@pytest.mark.parametrize("name", MADE)
def test_each_layout_gives_the_same_recording(made, name):
    folder, images, options = made(name)
    found = open_sequence(folder, **options)
    assert found.layout == find_loader(folder).name == name
    assert found.camera == CAMERA
    assert found.frame_ids == tuple(range(FRAMES))
    assert np.allclose(found.times_s - found.times_s[0], TIMES_S - TIMES_S[0], atol=1e-6)
    for i, image in enumerate(images):
        assert (found.read_image(i) == image).all()
    for one, other in zip(found.world_from_camera, POSES, strict=True):
        assert np.allclose(one.matrix, other.matrix, atol=1e-6)


def test_euroc_has_its_imu_with_its_mounting(made):
    folder, _, _ = made("euroc")
    found = open_sequence(folder)
    assert np.allclose(found.imu_from_camera.matrix, MOUNTED.matrix, atol=1e-9)
    assert found.imu.rate_hz == pytest.approx(100.0)
    assert np.allclose(found.imu.specific_force_m_s2[0], [0, 0, 9.81])
    assert open_sequence(folder / "mav0").frame_ids == found.frame_ids
    assert check_sequence(folder) == []


def test_an_image_that_is_listed_but_not_there_is_left_out_and_said(made):
    folder, _, _ = made("euroc")
    (folder / "mav0" / "cam0" / "data" / f"{STAMPS[3]}.png").unlink()
    found = open_sequence(folder)
    assert len(found) == FRAMES - 1
    assert any("1 of its images are not there" in note for note in found.notes)


def tracking(folder, rng):
    """KITTI tracking, whose calibration has keys with and without a colon."""
    write_images(rng, folder / "image_02" / "0001", [f"{i:06d}.png" for i in range(FRAMES)])
    row = " ".join(map(str, np.column_stack([CAMERA.matrix, [3.0, 0.0, 0.0]]).ravel()))
    calibration = folder / "calib" / "0001.txt"
    calibration.parent.mkdir()
    text = f"P0: {row}\nP1: {row}\nP2: {row}\nP3: {row}\nR_rect 1 0 0 0 1 0 0 0 1\n"
    text += "Tr_velo_cam 0 -1 0 0 0 0 -1 -0.08 1 0 0 -0.27\nTr_imu_velo 1 0 0 -0.81 0 1 0 0.32 0 0 1 -0.8\n"
    calibration.write_text(text)
    rows = []
    for i in range(FRAMES):
        latitude = 49.0 + np.degrees(1.0 * i / 6378137.0)
        start = [latitude, 8.4, 115.0, 0.0, 0.0, np.pi / 2, *[0.0] * 5, 0.1, 0.2, 9.81, *[0.0] * 3, 0.01, 0.02, 0.03]
        rows.append(" ".join(map(str, [*start, *[0.0] * 10])))
    (folder / "oxts").mkdir()
    (folder / "oxts" / "0001.txt").write_text("\n".join(rows) + "\n")
    return folder / "image_02" / "0001"


def test_kitti_tracking_is_as_the_raw_drive(raw, tmp_path, rng):
    path = tracking(tmp_path / "training", rng)
    found, other = open_sequence(path), open_sequence(raw)
    assert found.layout == "kitti-tracking"
    assert np.allclose(found.imu_from_camera.rotation, other.imu_from_camera.rotation)
    assert (found.camera.fx, found.camera.cx) == (60.0, 31.5)
    steps = [np.diff([p.translation for p in s.world_from_camera], axis=0) for s in (found, other)]
    assert np.allclose(*steps, atol=1e-2)
    assert np.allclose(found.world_from_camera[0].rotation, other.world_from_camera[0].rotation, atol=1e-6)
    assert any("10 frames a second" in note for note in found.notes)
    assert open_sequence(tmp_path / "training").frame_ids == found.frame_ids
    (tmp_path / "training" / "oxts" / "0001.txt").write_text("")
    with pytest.raises(SequenceError, match=r"0001\.txt: 0 samples, but frame 4 needs line 5"):
        open_sequence(path)


WRONG = {
    "no camera": ("frames", lambda f, o: o.pop("camera"), "give --camera FILE"),
    "camera of another aspect": ("frames", lambda f, o: o.update(size=(64, 30)), "do not scale to 64x30"),
    "size without a camera": ("euroc", lambda f, o: o.update(size=(64, 48)), "--size is not for recordings of the lay"),
    "topics of a folder": ("euroc", lambda f, o: o.update(topics={"image": "/a"}), "--topic is not for recordings"),
    "no images": ("tum-rgbd", lambda f, o: (f / "rgb.txt").write_text("# none\n"), "names no images"),
    "half a line": ("tum-rgbd", lambda f, o: (f / "rgb.txt").write_text("100.0\n"), "line 1: expected a time and an"),
    "unknown sensor": ("tum-rgbd", lambda f, o: o.pop("camera"), "none of freiburg1 to 3"),
    "no mounting": (
        "euroc",
        lambda f, o: (f / "mav0/cam0/sensor.yaml").write_text("sensor_type: camera\nresolution: [64, 48]\n"),
        "intrinsics: key is missing",
    ),
    "other camera": ("euroc", lambda f, o: o.update(camera_number=1), "cameras that are there: cam0"),
    "fisheye": ("kitti-360", lambda f, o: o.update(camera_number=2), "fisheye cameras 2 are not read"),
    "short stamps": (
        "kitti-360",
        lambda f, o: (f / "image_00/timestamps.txt").write_text("2013-05-28 08:46:10.0\n"),
        "1 lines, but 0000000004.png needs line 5",
    ),
    "no frame chosen": (
        "euroc",
        lambda f, o: o.update(frames="100:200"),
        "it has the frames 0 to 4",
    ),
    "odd range": ("euroc", lambda f, o: o.update(frames="5"), "expected FIRST:END"),
    "empty poses": ("frames", lambda f, o: o["poses"].write_text("# none\n"), "holds no poses"),
    "odd poses": ("frames", lambda f, o: o["poses"].write_text("1 2 3\n"), "expected TUM"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_use_is_one_line_that_says_what_to_do(made, case):
    name, change, said = WRONG[case]
    folder, _, options = made(name)
    change(folder, options)
    with pytest.raises(SequenceError) as caught:
        open_sequence(folder, **options)
    assert said in str(caught.value)
    assert len(str(caught.value)) < 300 + len(str(folder))


def test_a_part_is_chosen_by_numbers_and_times(made):
    folder, images, _ = made("euroc")
    part = open_sequence(folder, frames="1:5:2")
    assert part.frame_ids == (1, 3)
    assert (part.read_image(1) == images[3]).all()
    assert np.allclose(part.world_from_camera[1].matrix, POSES[3].matrix, atol=1e-6)
    assert part.left_out_frames == {0, 2, 4}
    assert any("2 of 5 frames are chosen: 1 to 3" in note for note in part.notes)
    assert open_sequence(folder, from_s=0.15, to_s=0.35).frame_ids == (2, 3)


def test_offsets_of_clocks_are_taken_off(made):
    folder, _, options = made("frames")
    late = format_tum(TIMES_S - 100 + 5.0, POSES)
    options["poses"].write_text(late)
    with pytest.raises(SequenceError, match="another clock"):
        open_sequence(folder, **options)
    found = open_sequence(folder, **options, poses_time_offset_s=5.0)
    assert np.allclose(found.world_from_camera[2].matrix, POSES[2].matrix, atol=1e-6)
    imu = made_imu(folder)
    plain, moved = (
        open_sequence(folder, **options, poses_time_offset_s=5.0, imu=imu, imu_time_offset_s=t) for t in (0, 0.02)
    )
    assert np.allclose(plain.imu.times_s - moved.imu.times_s, 0.02)


def test_poses_of_any_scale_are_made_metres(made, tmp_path):
    folder, _, options = made("frames")
    plain = open_sequence(folder, **options)
    found = open_sequence(folder, **options, poses_scale=2.5)
    assert np.allclose(found.world_from_camera[2].translation, 2.5 * plain.world_from_camera[2].translation)
    assert (found.world_from_camera[2].rotation == plain.world_from_camera[2].rotation).all()
    with pytest.raises(SequenceError, match="--poses-scale, but no poses are known"):
        open_sequence(folder, **{name: value for name, value in options.items() if name != "poses"}, poses_scale=2.5)
    body = tmp_path / "body.yaml"
    body.write_text(f"camera_from_body: {np.eye(4).tolist()}")
    with pytest.raises(SequenceError, match="is in metres, so poses of a body must be, too"):
        open_sequence(folder, **options, camera_from_body=body, poses_scale=2.5)


def made_imu(folder):
    path = folder.parent / "imu.csv"
    rows = [f"{0.01 * k},0,0,0,0,0,9.81" for k in range(60)]
    path.write_text("\n".join(["timestamp,wx,wy,wz,ax,ay,az", *rows]) + "\n")
    return path


def pose_rows(kind):
    """The path in other tools' words."""
    if kind == "vins":
        stamps = [round(1e9 * (t - 100)) for t in TIMES_S]
        rows = [[s, *p.translation, *p.to_quaternion(order="wxyz")] for s, p in zip(stamps, POSES, strict=True)]
        return "\n".join(",".join(map(str, row)) + "," for row in rows)
    if kind == "kitti":
        back = Pose(levelled_path()[0].rotation, np.zeros(3)).inverse()
        return "\n".join(" ".join(map(str, (back @ p).matrix[:3].ravel())) for p in POSES)
    if kind == "colmap":
        lines = []
        for i, pose in enumerate(POSES):
            back = (Pose(levelled_path()[0].rotation, np.zeros(3)).inverse() @ pose).inverse()
            words = [i + 1, *back.to_quaternion(order="wxyz"), *back.translation, 1, f"frame_{i}.png"]
            lines += [" ".join(map(str, words)), "10.0 20.0 -1"]
        return "# Image list\n" + "\n".join(lines)
    return format_tum((TIMES_S - 100) * 1e9 + 1e18, POSES)


@pytest.mark.parametrize("kind", ["vins", "kitti", "colmap"])
def test_poses_of_other_tools(made, kind):
    folder, _, options = made("frames")
    options["poses"].write_text(pose_rows(kind))
    found = open_sequence(folder, **options)
    for one, other in zip(found.world_from_camera, POSES, strict=True):
        assert np.allclose(one.matrix, other.matrix, atol=1e-6)


def test_names_that_are_stamps_are_times(tmp_path, rng):
    folder = tmp_path / "cam"
    write_images(rng, folder, [f"{stamp + 1_400_000_000_000_000_000}.png" for stamp in STAMPS])
    found = open_sequence(folder, camera=camera_file(folder))
    assert np.allclose(np.diff(found.times_s), 0.1, atol=1e-6)
    assert found.frame_ids == tuple(range(FRAMES))


def test_frames_without_times_have_a_rate_that_is_said(made):
    folder, _, options = made("frames")
    assert any("10 frames a second" in note for note in open_sequence(folder, **options).notes)
    del options["poses"]
    assert open_sequence(folder, **options, rate_hz=20.0).times_s[1] == pytest.approx(0.05)


def colmap_rows():
    """camera_from_world of the path in a first camera's world: quaternion with w first, translation."""
    back = Pose(levelled_path()[0].rotation, np.zeros(3)).inverse()
    poses = [(back @ pose).inverse() for pose in POSES]
    return [[*p.to_quaternion(order="wxyz"), *p.translation] for p in poses]


def colmap(folder, rng, binary):
    names = [f"{i:06d}.png" for i in range(FRAMES)]
    images = write_images(rng, folder / "images", names)
    model = folder / "sparse" / "0"
    model.mkdir(parents=True)
    parameters = [CAMERA.fx, CAMERA.fy, CAMERA.cx + 0.5, CAMERA.cy + 0.5]
    if binary:
        (model / "cameras.bin").write_bytes(struct.pack("<QiiQQ4d", 1, 1, 1, 64, 48, *parameters))
        rows = [
            struct.pack("<i7di", i + 1, *row, 1) + name.encode() + b"\0" + struct.pack("<Q2dq", 1, 3.0, 4.0, -1)
            for i, (row, name) in enumerate(zip(colmap_rows(), names, strict=True))
        ]
        (model / "images.bin").write_bytes(struct.pack("<Q", len(rows)) + b"".join(rows))
    else:
        (model / "cameras.txt").write_text("1 PINHOLE 64 48 " + " ".join(map(str, parameters)))
        rows = zip(colmap_rows(), names, strict=True)
        lines = [" ".join(map(str, [i + 1, *row, 1, name])) + "\n" for i, (row, name) in enumerate(rows)]
        (model / "images.txt").write_text("# two lines an image\n" + "\n".join(lines) + "\n")
    return images


@pytest.mark.parametrize("binary", [True, False])
def test_colmap_projects(tmp_path, rng, binary):
    folder = tmp_path / "project"
    images = colmap(folder, rng, binary)
    found = open_sequence(folder)
    assert found.layout == "colmap"
    assert (found.camera.cx, found.camera.cy) == (CAMERA.cx, CAMERA.cy)
    assert (found.read_image(3) == images[3]).all()
    for one, other in zip(found.world_from_camera, POSES, strict=True):
        assert np.allclose(one.matrix, other.matrix, atol=1e-6)
    (folder / "images" / "000002.png").unlink()
    assert open_sequence(folder).frame_ids == (0, 1, 3, 4)
    file = next((folder / "sparse" / "0").glob("images.*"))
    file.write_bytes(file.read_bytes()[:-70])
    if binary:
        with pytest.raises(SequenceError, match=r"images\.bin: is no images\.bin of COLMAP, or is cut"):
            open_sequence(folder)


def nuscenes(folder, rng):
    images = write_images(rng, folder / "samples" / "CAM_FRONT", [f"{i}.png" for i in range(FRAMES)])
    tables = {
        "scene": [{"token": f"s{k}", "name": f"scene-000{k}"} for k in (1, 2)],
        "sample": [{"token": "a", "scene_token": "s1"}, {"token": "b", "scene_token": "s2"}],
        "sensor": [{"token": "front", "channel": "CAM_FRONT"}, {"token": "top", "channel": "LIDAR_TOP"}],
        "calibrated_sensor": [
            {
                "token": "c1",
                "sensor_token": "front",
                "translation": MOUNTED.translation.tolist(),
                "rotation": MOUNTED.to_quaternion(order="wxyz").tolist(),
                "camera_intrinsic": CAMERA.matrix.tolist(),
            },
            {"token": "c2", "sensor_token": "top", "camera_intrinsic": []},
        ],
        "ego_pose": [
            {
                "token": f"e{i}",
                "translation": (pose @ MOUNTED.inverse()).translation.tolist(),
                "rotation": (pose @ MOUNTED.inverse()).to_quaternion(order="wxyz").tolist(),
            }
            for i, pose in enumerate(POSES)
        ],
    }
    frame = {"sample_token": "a", "calibrated_sensor_token": "c1", "width": 64, "height": 48}
    rows = [
        frame
        | {
            "token": f"d{i}",
            "ego_pose_token": f"e{i}",
            "timestamp": round(1e6 * t),
            "filename": f"samples/CAM_FRONT/{i}.png",
        }
        for i, t in enumerate(TIMES_S)
    ]
    tables["sample_data"] = [
        *rows[::-1],
        rows[0] | {"token": "x", "calibrated_sensor_token": "c2", "filename": "l.bin"},
    ]
    (folder / "v1.0-mini").mkdir()
    for name, table in tables.items():
        (folder / "v1.0-mini" / f"{name}.json").write_text(json.dumps(table))
    (folder / "can_bus").mkdir()
    samples = [
        {"utime": round(1e6 * (100 + 0.01 * k)), "rotation_rate": [0.0, 0.0, 0.1], "linear_accel": [0.0, 0.0, 9.8]}
        for k in range(41)
    ]
    (folder / "can_bus" / "scene-0001_ms_imu.json").write_text(json.dumps(samples))
    return images


def test_nuscenes(tmp_path, rng):
    folder = tmp_path / "nuscenes"
    images = nuscenes(folder, rng)
    with pytest.raises(SequenceError, match=r"holds 2 scenes: choose one by --scene NAME: scene-0001, scene-0002"):
        open_sequence(folder)
    with pytest.raises(SequenceError, match="has no scene 'x'"):
        open_sequence(folder, scene="x")
    with pytest.raises(SequenceError, match=r"sample_data\.json: scene-0002: has no frame of CAM_FRONT"):
        open_sequence(folder, scene="scene-0002")
    found = open_sequence(folder, scene="scene-0001")
    assert found.camera == CAMERA
    assert (found.read_image(4) == images[4]).all()
    assert np.allclose(found.times_s, TIMES_S)
    for one, other in zip(found.world_from_camera, POSES, strict=True):
        assert np.allclose(one.matrix, other.matrix, atol=1e-6)
    assert np.allclose(found.imu_from_camera.matrix, MOUNTED.matrix, atol=1e-9)
    assert found.imu.rate_hz == pytest.approx(100)
    (folder / "v1.0-mini" / "ego_pose.json").write_text("[]")
    with pytest.raises(
        SequenceError, match=r"ego_pose\.json: 5 rows that sample_data\.json names are not there, such as e0"
    ):
        open_sequence(folder, scene="scene-0001")
