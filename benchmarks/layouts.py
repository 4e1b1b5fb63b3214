"""One recording in every layout: does `map` find the same cars in each?

    python benchmarks/layouts.py KITTI_RAW_DRIVE SEGMENTER OUT [--only LAYOUT …]

Writes the drive in each layout, its images as links, maps it there and in its own layout, and prints for each: cars,
the greatest distance between the centres of a car here and there, and what `check` says.
"""

from __future__ import annotations

import argparse
import importlib
import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import yaml

from meshslam.geometry import Pose
from meshslam.maps import Map
from meshslam.sequences import Sequence, camera_yaml, format_tum, open_sequence

HEIGHT_M = 1.55  # of KITTI-360's camera above the ground
Written = tuple[Path, list[str]]  # the recording, and the flags that it needs


def row(values: np.ndarray) -> str:
    """Numbers of a line."""
    return " ".join(f"{value:.12g}" for value in np.ravel(values))


def link(source: Path, target: Path) -> None:
    """Links between whole paths."""
    target.parent.mkdir(parents=True, exist_ok=True)
    target.symlink_to(source.resolve())


def euroc(drive: Sequence, out: Path) -> Written:
    """mav0 with cam0, imu0 and the ground truth; the body is the IMU."""
    stamps = [round(1e9 * (100 + t)) for t in drive.times_s]
    camera, mounted = drive.camera, drive.imu_from_camera
    for stamp, path in zip(stamps, drive.image_paths, strict=True):
        link(path, out / f"mav0/cam0/data/{stamp}{path.suffix}")
    rows = [f"{stamp},{stamp}{path.suffix}" for stamp, path in zip(stamps, drive.image_paths, strict=True)]
    (out / "mav0/cam0/data.csv").write_text("\n".join(["#timestamp [ns],filename", *rows]) + "\n")
    sensor = {
        "sensor_type": "camera",
        "T_BS": {"rows": 4, "cols": 4, "data": mounted.matrix.ravel().tolist()},
        "resolution": [camera.width, camera.height],
        "camera_model": "pinhole",
        "intrinsics": [camera.fx, camera.fy, camera.cx, camera.cy],
        "distortion_model": "radial-tangential",
        "distortion_coefficients": [0.0, 0.0, 0.0, 0.0],
    }
    (out / "mav0/cam0/sensor.yaml").write_text(yaml.safe_dump(sensor))
    (out / "mav0/imu0").mkdir()
    imu = np.column_stack([drive.imu.angular_rate_rad_s, drive.imu.specific_force_m_s2])
    lines = [
        ",".join([str(round(1e9 * (100 + t))), *map(repr, values.tolist())])
        for t, values in zip(drive.imu.times_s, imu, strict=True)
    ]
    (out / "mav0/imu0/data.csv").write_text("\n".join(["#timestamp [ns],w_x,w_y,w_z,a_x,a_y,a_z", *lines]) + "\n")
    identity = {"T_BS": {"rows": 4, "cols": 4, "data": np.eye(4).ravel().tolist()}}
    (out / "mav0/imu0/sensor.yaml").write_text(yaml.safe_dump(identity))
    truth = out / "mav0/state_groundtruth_estimate0"
    truth.mkdir()
    bodies = [pose @ mounted.inverse() for pose in drive.world_from_camera]
    lines = [
        ",".join([str(s), *map(repr, p.translation.tolist()), *map(repr, p.to_quaternion(order="wxyz").tolist())])
        for s, p in zip(stamps, bodies, strict=True)
    ]
    (truth / "data.csv").write_text("\n".join(["#timestamp,x,y,z,qw,qx,qy,qz", *lines]) + "\n")
    (truth / "sensor.yaml").write_text(yaml.safe_dump(identity))
    return out, []


def tum_rgbd(drive: Sequence, out: Path) -> Written:
    """rgb.txt, rgb/, groundtruth.txt, and a Kalibr camchain beside."""
    names = [f"rgb/{100 + t:.6f}{p.suffix}" for t, p in zip(drive.times_s, drive.image_paths, strict=True)]
    for name, path in zip(names, drive.image_paths, strict=True):
        link(path, out / name)
    rows = [f"{100 + t:.6f} {name}" for t, name in zip(drive.times_s, names, strict=True)]
    (out / "rgb.txt").write_text("\n".join(["# color images", "# timestamp filename", *rows]) + "\n")
    (out / "groundtruth.txt").write_text("# ground truth\n" + format_tum(drive.times_s + 100, drive.world_from_camera))
    return out, ["--camera", str(camchain(drive, out))]


def camchain(drive: Sequence, out: Path) -> Path:
    """Kalibr's file of one camera."""
    camera, path = drive.camera, out.with_name(f"{out.name}_camchain.yaml")
    entry = {
        "camera_model": "pinhole",
        "intrinsics": [camera.fx, camera.fy, camera.cx, camera.cy],
        "distortion_model": "radtan",
        "distortion_coeffs": [0.0, 0.0, 0.0, 0.0],
        "resolution": [camera.width, camera.height],
    }
    path.write_text(yaml.safe_dump({"cam0": entry}))
    return path


def kitti_tracking(drive: Sequence, out: Path) -> Written:
    """training/image_02, calib, oxts: one line of OXTS a frame."""
    for i, path in enumerate(drive.image_paths):
        link(path, out / f"training/image_02/0048/{i:06d}{path.suffix}")
    date = drive.root.parent
    cameras, velo, imu = (
        dict(line.partition(":")[::2] for line in (date / name).read_text().splitlines() if ":" in line)
        for name in ("calib_cam_to_cam.txt", "calib_velo_to_cam.txt", "calib_imu_to_velo.txt")
    )
    rigid = {
        name: row(np.column_stack([np.fromstring(c["R"], sep=" ").reshape(3, 3), np.fromstring(c["T"], sep=" ")]))
        for name, c in (("Tr_velo_cam", velo), ("Tr_imu_velo", imu))
    }
    lines = [f"P{n}:{cameras[f'P_rect_0{n}']}" for n in range(4)]
    lines += [f"R_rect{cameras['R_rect_00']}", *(f"{name} {text}" for name, text in rigid.items())]
    (out / "training/calib").mkdir()
    (out / "training/calib/0048.txt").write_text("\n".join(lines) + "\n")
    samples = sorted((drive.root / "oxts/data").glob("*.txt"))
    (out / "training/oxts").mkdir()
    text = "".join(samples[n].read_text().strip() + "\n" for n in drive.frame_ids)
    (out / "training/oxts/0048.txt").write_text(text)
    return out / "training/image_02/0048", []


def kitti_360(drive: Sequence, out: Path) -> Written:
    """data_2d_raw, data_poses, calibration; the rectified camera is the drive's."""
    name = "2013_05_28_drive_0048_sync"
    home = out / "data_2d_raw" / name
    for i, path in enumerate(drive.image_paths):
        link(path, home / f"image_00/data_rect/{i:010d}{path.suffix}")
    stamps = "".join(f"2013-05-28 08:46:{10 + t:012.9f}\n" for t in drive.times_s)
    (home / "image_00/timestamps.txt").write_text(stamps)
    camera = drive.camera
    projection = np.column_stack([camera.matrix, np.zeros(3)])
    (out / "calibration").mkdir()
    (out / "calibration/perspective.txt").write_text(
        f"S_rect_00: {camera.width} {camera.height}\nR_rect_00: {row(np.eye(3))}\nP_rect_00: {row(projection)}\n"
    )
    mounted = drive.imu_from_camera
    (out / "calibration/calib_cam_to_pose.txt").write_text(f"image_00: {row(mounted.matrix[:3])}\n")
    poses = [pose @ mounted.inverse() for pose in drive.world_from_camera]
    lines = [f"{i} {row(p.matrix[:3])}" for i, p in enumerate(poses)]
    (out / "data_poses" / name).mkdir(parents=True)
    (out / "data_poses" / name / "poses.txt").write_text("\n".join(lines) + "\n")
    return home, []


def frames(drive: Sequence, out: Path) -> Written:
    """A folder of images, poses of a first camera in KITTI's twelve numbers, OpenCV's file of the camera."""
    import cv2

    for i, path in enumerate(drive.image_paths):
        link(path, out / f"frame_{i}{path.suffix}")
    calibration = out.with_name(f"{out.name}_opencv.yaml")
    storage = cv2.FileStorage(str(calibration), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", drive.camera.width)
    storage.write("image_height", drive.camera.height)
    storage.write("camera_matrix", drive.camera.matrix)
    storage.write("distortion_coefficients", np.zeros((1, 5)))
    storage.release()
    poses = out.with_name(f"{out.name}_poses.tum")
    poses.write_text(format_tum(np.arange(len(drive)) / 10.0, drive.world_from_camera))
    return out, ["--camera", str(calibration), "--poses", str(poses)]


def folder(drive: Sequence, out: Path, height_m: float = 1.65) -> Written:
    """The sequence folder, the camera at a height above the ground."""
    for i, path in enumerate(drive.image_paths):
        link(path, out / f"images/{i:06d}{path.suffix}")
    (out / "camera.yaml").write_text(camera_yaml(drive.camera, None, drive.imu_from_camera, height_m))
    (out / "times.txt").write_text("".join(f"{t:.9f}\n" for t in drive.times_s))
    (out / "poses.tum").write_text(format_tum(drive.times_s, drive.world_from_camera))
    return out, []


def bag_writing() -> Any:  # the tests' module
    """The writers of bags that tests use; the checkout must be the folder that the script is in."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    return importlib.import_module("tests.sequences.bag_writing"), importlib.import_module("scripts.recording_as_bag")


def ros1_bag(drive: Sequence, out: Path) -> Written:
    """By rosbags' writer, compressed."""
    writing, messages = bag_writing()
    ros, path = writing.Ros(1), out.with_suffix(".bag")
    return writing.write_ros1(path, ros, list(messages.said(ros, drive, 1)), "BZ2"), []


def ros2_sqlite(drive: Sequence, out: Path) -> Written:
    """By rosbags' writer."""
    writing, messages = bag_writing()
    ros = writing.Ros(2)
    return writing.write_ros2(out, ros, list(messages.said(ros, drive, 1))), []


def ros2_mcap(drive: Sequence, out: Path) -> Written:
    """By rosbags' writer, each message compressed by zstd."""
    writing, messages = bag_writing()
    ros = writing.Ros(2)
    return writing.write_ros2(out, ros, list(messages.said(ros, drive, 1)), "MCAP", "MESSAGE"), []


def foxglove(drive: Sequence, out: Path) -> Written:
    """MCAP with Foxglove's schemas as Protocol Buffers: PNG images, transforms."""
    writing, messages = bag_writing()
    bodies = [pose @ messages.CAMERA_FROM_BODY for pose in drive.world_from_camera]
    stamps = [writing.START_NS + round(1e9 * t) for t in drive.times_s]
    images = [drive.read_image(i) for i in range(len(drive))]
    shown = SimpleNamespace(
        times_ns=stamps,
        images=images,
        world_from_body=bodies,
        camera=drive.camera,
        camera_from_body=messages.CAMERA_FROM_BODY,
        distortion=[0.0] * 5,
    )
    return writing.write_foxglove(out.with_suffix(".mcap"), writing.foxglove_of(shown), "protobuf"), []


def video(drive: Sequence, out: Path) -> Written:
    """MP4 by H.264, uneven steps, with Kalibr's camchain and poses in TUM's form."""
    import av

    path = out.with_suffix(".mp4")
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=10, options={"crf": "12", "g": "12"})
        stream.width, stream.height, stream.pix_fmt = drive.camera.width, drive.camera.height - 1, "yuv420p"
        stream.codec_context.time_base = Fraction(1, 10_000)
        for i, time_s in enumerate(drive.times_s):
            frame = av.VideoFrame.from_ndarray(drive.read_image(i)[:-1], format="bgr24")  # even sizes alone
            frame.pts, frame.time_base = round(1e4 * time_s), Fraction(1, 10_000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    camera = replace(drive.camera, height=drive.camera.height - 1)
    poses = out.with_name(f"{out.name}_poses.tum")
    poses.write_text(format_tum(drive.times_s, drive.world_from_camera))
    return path, ["--camera", str(camchain(replace(drive, camera=camera), out)), "--poses", str(poses)]


LAYOUTS: dict[str, Callable[[Sequence, Path], Written]] = {
    "folder": folder,
    "euroc": euroc,
    "tum-rgbd": tum_rgbd,
    "kitti-tracking": kitti_tracking,
    "kitti-360": kitti_360,
    "frames": frames,
    "ros1-bag": ros1_bag,
    "ros2-sqlite": ros2_sqlite,
    "ros2-mcap-zstd": ros2_mcap,
    "mcap-foxglove": foxglove,
    "video": video,
}


def meshslam(*arguments: object) -> tuple[int, str]:
    """Exit code and what a command said."""
    command = [sys.executable, "-m", "meshslam", *map(str, arguments)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    return ended.returncode, ended.stdout + ended.stderr


def centres(run: Path, to_common: Pose) -> np.ndarray:
    """Of the cars (n, 3), in the frame of the first camera."""
    return np.array([to_common.transform(thing.world_from_object.translation) for thing in Map.load(run).objects])


def first_camera(run: Path) -> Pose:
    """camera_from_world of a run's first frame."""
    from meshslam.maps import Trajectory

    return Trajectory.load(run / "trajectory.tum").world_from_camera[0].inverse()


def main() -> int:
    """Print the table; 1 if a layout gives other cars."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("drive", "segmenter", "out"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--only", nargs="*", default=list(LAYOUTS))
    given = parser.parse_args()
    drive, wrong = open_sequence(given.drive), 0
    reference = given.out / "run_kitti-raw"
    code, said = meshslam("map", given.drive, "--segmenter", given.segmenter, "--out", reference)
    assert code == 0, said
    known = centres(reference, first_camera(reference))
    print("| layout | cars | farthest centre | check |\n| --- | --- | --- | --- |", flush=True)
    print(f"| kitti-raw | {len(known)} | | |", flush=True)
    for name in given.only:
        path, flags = LAYOUTS[name](drive, given.out / name)
        checked, found = meshslam("check", path, *flags, "--json")
        problems = json.JSONDecoder().raw_decode(found)[0]["problems"] if found.startswith("{") else found
        run = given.out / f"run_{name}"
        code, said = meshslam("map", path, *flags, "--segmenter", given.segmenter, "--out", run)
        if code:
            print(f"| {name} | {said.strip().splitlines()[-1]} | | {problems} |", flush=True)
            wrong += 1
            continue
        there = centres(run, first_camera(run))
        expected = known
        if name == "kitti-360":  # its cars' camera is lower, which moves the ground
            lower, _ = folder(drive, given.out / "folder_low", HEIGHT_M)
            twin = given.out / "run_folder_low"
            assert meshslam("map", lower, "--segmenter", given.segmenter, "--out", twin)[0] == 0
            expected = centres(twin, first_camera(twin))
        apart = np.linalg.norm(there[:, None] - expected[None], axis=2)
        farthest_m = max(apart.min(0).max(), apart.min(1).max())
        wrong += len(there) != len(known) or farthest_m > 0.05 or checked != 0
        print(f"| {name} | {len(there)} | {farthest_m:.4f} m | {problems} problems |", flush=True)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
