"""Bags as sequences: what was asked for and what is there, put together."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from meshslam.errors import SequenceError
from meshslam.files import real_path
from meshslam.geometry import Floats, Pose
from meshslam.sequences.bags.camera import camera_of_info, is_rectified_topic
from meshslam.sequences.bags.images import BagImages
from meshslam.sequences.bags.index import BagIndex, Topic
from meshslam.sequences.bags.index_file import indexed
from meshslam.sequences.bags.mcap_files import MAGIC as MCAP_MAGIC
from meshslam.sequences.bags.mcap_files import McapFiles
from meshslam.sequences.bags.rosbag1 import MAGIC as ROS1_MAGIC
from meshslam.sequences.bags.rosbag1 import Ros1Bag
from meshslam.sequences.bags.rosbag2 import is_ros2_folder, open_ros2_files, open_ros2_folder
from meshslam.sequences.bags.store import MISSING, Store
from meshslam.sequences.bags.topics import camera_topic, image_topic, imu_topic, poses_topic
from meshslam.sequences.bags.transforms import fixed_transform, moving_poses, moving_root, poses_of
from meshslam.sequences.bags.unpacking import unpacking_command
from meshslam.sequences.bags.video_images import BagVideo, from_first_key, is_read
from meshslam.sequences.cameras.read import read_camera
from meshslam.sequences.folder import CameraFile
from meshslam.sequences.image_source import ImageSource
from meshslam.sequences.loader import LoadOptions
from meshslam.sequences.pose_matching import all_or_some, poses_at
from meshslam.sequences.report import Report, fail
from meshslam.sequences.sequence import ImuSamples, Sequence

_SQLITE_MAGIC = b"SQLite format 3\0"
_ON_THE_GROUND = "base_footprint"
_WORLDS = ("map", "odom", "world", "earth")  # frames that stand still (REP 105)
_ACCEPTS = frozenset({"topics", "camera_file", "conventions", "size"})


@dataclass(frozen=True)
class RosBag:
    """ROS 1 bags (a .bag file) and ROS 2 bags (a folder, or its .db3 file)."""

    name: str = "ros-bag"
    looks_for: str = "a .bag file, or a folder that holds metadata.yaml of rosbag2"
    accepts: frozenset[str] = _ACCEPTS

    def recognizes(self, path: Path) -> bool:
        """By a file's first bytes, or a folder's metadata."""
        if path.is_dir():
            return is_ros2_folder(path)
        if unpacking_command(path, (".bag", ".db3")):
            return path.is_file()
        start = _start(path)
        return start.startswith(ROS1_MAGIC) or (path.suffix == ".db3" and start.startswith(_SQLITE_MAGIC))

    def image_files(self, path: Path, options: LoadOptions) -> list[Path]:
        """None: images lie in the bag."""
        return []

    def load(self, path: Path, options: LoadOptions, report: Report) -> Sequence:
        """See Loader."""
        _check_installed(path)
        _check_unpacked(path)
        return _loaded(self.name, _ros_store(path, report), options, report)


@dataclass(frozen=True)
class Mcap:
    """MCAP files with messages of ROS 1, ROS 2 or Foxglove's schemas."""

    name: str = "mcap"
    looks_for: str = "a .mcap file"
    accepts: frozenset[str] = _ACCEPTS

    def recognizes(self, path: Path) -> bool:
        """By a file's first bytes."""
        return path.is_file() and (_start(path).startswith(MCAP_MAGIC) or bool(unpacking_command(path, (".mcap",))))

    def image_files(self, path: Path, options: LoadOptions) -> list[Path]:
        """None: images lie in the file."""
        return []

    def load(self, path: Path, options: LoadOptions, report: Report) -> Sequence:
        """See Loader."""
        _check_installed(path)
        _check_unpacked(path)
        if not path.is_file() or not _start(path).startswith(MCAP_MAGIC):
            raise fail(path, "", "no MCAP file: its first bytes are not MCAP's")
        return _loaded(self.name, McapFiles(path, (path,)), options, report)


def _check_installed(path: Path) -> None:
    if any(importlib.util.find_spec(name) is None for name in ("rosbags", "mcap")):
        raise SequenceError(f"{path}: {MISSING}")


def _check_unpacked(path: Path) -> None:
    command = unpacking_command(path, (".bag", ".db3", ".mcap")) if path.is_file() else ""
    if command:
        raise fail(path, "", f"the file is compressed as a whole: unpack it first: {command}")


def _start(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(16)
    except OSError:
        return b""


def _ros_store(path: Path, report: Report) -> Store:
    start = b"" if path.is_dir() else _start(path)
    if start.startswith(ROS1_MAGIC):
        return Ros1Bag(path)
    if start.startswith(_SQLITE_MAGIC):
        return open_ros2_files(path, [path], "")
    if path.is_dir() and is_ros2_folder(path):
        return open_ros2_folder(path, report)
    found = f"it begins with {start[:13]!r}" if start else "it is empty" if path.is_file() else "no metadata.yaml"
    raise fail(path, "", f"neither a ROS 1 bag of format 2.0 nor a ROS 2 bag's folder: {found}")


def _loaded(layout: str, store: Store, options: LoadOptions, report: Report) -> Sequence:
    path = store.path
    if options.camera_number is not None:
        raise SequenceError(
            f"{path}: a bag's cameras have no numbers: choose by --topic image=/… instead of --camera N"
        )
    read = indexed(store, options.kept_index, report)
    index = read.index
    topic = image_topic(index, options.topics, report)
    times_ns, order = _times_ns(path, topic, report)
    images, kept = _images(store, topic, order, report)
    times_s = times_ns[kept] / 1e9
    camera = _camera(index, topic, images, options, report)
    imu, imu_from_camera = _imu(index, topic, times_s, options, report) if options.has_own_imu else (None, None)
    poses = _poses(index, topic, times_s, options, report) if options.has_own_poses else {}
    height_m = camera.height_above_ground_m or _height_m(index, topic, report)
    every, some = all_or_some(poses, len(times_s))
    return Sequence(
        name=real_path(path).name.removesuffix(path.suffix),
        layout=layout,
        root=path,
        camera=camera.camera,
        frame_ids=tuple(range(len(times_s))),
        times_s=times_s,
        images=images,
        world_from_camera=every,
        is_levelled=options.poses_convention != "first-camera-world",
        detections_path=options.detections_path,
        imu=imu,
        imu_from_camera=imu_from_camera or camera.imu_from_camera,
        height_above_ground_m=height_m,
        distortion=camera.distortion,
        partial_poses=some,
        index=read,
    )


def _images(store: Store, topic: Topic, order: list[int], report: Report) -> tuple[BagImages | BagVideo, list[int]]:
    """The frames' images, and which of the times they have."""
    if topic.is_video:
        if not is_read(topic.form):
            what = f"its video is {topic.form!r:.40}: only h264 and h265 are read, convert it to one of them"
            raise fail(store.path, topic.name, what)
        kept = from_first_key(topic.name, topic.keys, order, store, report)
        every, keys, numbers = tuple(topic.positions), tuple(topic.keys), tuple(range(len(kept)))
        chosen = tuple(order[place] for place in kept)
        return BagVideo(store, topic.channel, topic.form, every, keys, chosen, numbers), kept
    positions = tuple(topic.positions[i] for i in order)
    images = BagImages(store, topic.channel, positions, tuple(range(len(order))))
    return replace(images, bits=images.depth(report)), list(range(len(order)))


def _times_ns(path: Path, topic: Topic, report: Report) -> tuple[Floats, list[int]]:
    """Increasing times (n,) and which messages they are of: header stamps, or log times where there are none."""
    stamps, logged = np.array(topic.header_ns, np.int64), np.array(topic.log_ns, np.int64)
    if not stamps.any():
        report.note(path, topic.name, "header stamps are all zero: the times at which messages were written are taken")
        stamps = logged
    if (np.diff(stamps) < 0).any():
        report.note(path, topic.name, f"{(np.diff(stamps) < 0).sum()} stamps are before the one before: put in order")
    distinct, order = np.unique(stamps, return_index=True)
    if len(distinct) < len(stamps):
        report.note(path, topic.name, f"{len(stamps) - len(distinct)} messages have another's stamp: the first is kept")
    return distinct.astype(float), order.tolist()


def _camera(index: BagIndex, topic: Topic, images: ImageSource, options: LoadOptions, report: Report) -> CameraFile:
    height, width = images.read(0, None).shape[:2]
    if options.camera_file is not None:
        size = options.size or (width, height)
        camera = read_camera(options.camera_file, options.camera_number, size, report)
        source = str(options.camera_file)
    else:
        found = camera_topic(index, options.topics, topic)
        if found is None:
            there = ", ".join(t.name for t in index.of("camera"))
            more = f"of {there} none is {topic.name}'s: --topic camera=/…" if there else "no CameraInfo is there"
            raise fail(index.path, topic.name, f"its camera is not known, {more}: give --camera FILE")
        camera, source = _of_info(index, topic, found, report), found.name
    raw = camera.camera if camera.distortion is None else camera.distortion.raw_camera
    if (raw.width, raw.height) != (width, height):
        what = f"images are {width}x{height}, but {source} is of {raw.width}x{raw.height}: give --camera FILE"
        raise fail(index.path, topic.name, what)
    return camera


def _of_info(index: BagIndex, topic: Topic, found: Topic, report: Report) -> CameraFile:
    is_rectified = is_rectified_topic(topic.name)
    if found.changes:
        report.note(index.path, found.name, f"the calibration changes {found.changes} times: the first is taken")
    if is_rectified:
        report.note(index.path, topic.name, f"rectified by its name: P of {found.name} is taken, no distortion")
    return camera_of_info(index.path, found.name, found.camera, is_rectified, report)


def _imu(
    index: BagIndex, image: Topic, times_s: Floats, options: LoadOptions, report: Report
) -> tuple[ImuSamples | None, Pose | None]:
    topic = imu_topic(index, options.topics, report)
    if topic is None:
        return None, None
    imu_ns, order = _times_ns(index.path, topic, report)
    rows = topic.rows[order]
    imu = ImuSamples(imu_ns / 1e9, rows[:, :3], rows[:, 3:])
    if imu.times_s[0] > times_s[-1] or imu.times_s[-1] < times_s[0]:
        what = "no sample lies between the first and the last frame: another clock? The IMU is left out"
        report.note(index.path, topic.name, what)
        return None, None
    mounted = fixed_transform(index, topic.frame, image.frame)
    if mounted is None:
        frames = f"no transforms lead from {image.frame or 'an unnamed frame'} to {topic.frame or 'an unnamed frame'}"
        what = f"{frames}, so that imu_from_camera is not known: localize and slam need --imu-from-camera FILE"
        report.note(index.path, topic.name, what)
    return imu, mounted


def _height_m(index: BagIndex, image: Topic, report: Report) -> float | None:
    """Of the camera over base_footprint, which lies on the ground (REP 105, REP 120)."""
    for frame in sorted({frame for pair in index.edges for frame in pair}):
        mounted = fixed_transform(index, frame, image.frame) if frame.rpartition("/")[2] == _ON_THE_GROUND else None
        if mounted is not None and mounted.translation[2] > 0:
            height_m = float(mounted.translation[2])
            report.note(index.path, image.name, f"the camera is {height_m:.3f} m above the ground, by {frame}")
            return height_m
    return None


def _poses(index: BagIndex, image: Topic, times_s: Floats, options: LoadOptions, report: Report) -> dict[int, Pose]:
    """world_from_camera by frame."""
    named = dict(options.topics)
    chosen = named.get("poses", "")
    if chosen in index.transform_topics:
        return _of_transforms(index, image, times_s, report, is_named=True)
    topic = poses_topic(index, named, report)
    if topic is None:
        return {} if index.of("poses") else _of_transforms(index, image, times_s, report, is_named=False)
    converted = _body(index, image, topic, options, report)
    if converted is None:
        return {}
    pose_ns, order = _times_ns(index.path, topic, report)
    poses = converted.world_from_camera(poses_of(topic.rows[order]))
    return poses_at(times_s, pose_ns / 1e9, poses, index.path, report)


def _body(index: BagIndex, image: Topic, topic: Topic, options: LoadOptions, report: Report) -> LoadOptions | None:
    """The options with camera_from_body as the transforms have it; None where poses of a body cannot be used."""
    if options.camera_from_body is not None or options.poses_convention != "camera":
        return options
    if not topic.child_frame:
        what = "poses that name no body are taken as the camera's (else --camera-from-body FILE, or --poses-convention)"
        report.note(index.path, topic.name, what)
        return options
    mounted = fixed_transform(index, image.frame, topic.child_frame)
    if mounted is None:
        frames = f"poses are of {topic.child_frame}, and no transforms lead to {image.frame or 'the camera'}"
        report.note(index.path, topic.name, f"{frames}: not used, give --camera-from-body FILE or --poses-convention")
        return None
    return replace(options, camera_from_body=mounted)


def _of_transforms(
    index: BagIndex, image: Topic, times_s: Floats, report: Report, *, is_named: bool
) -> dict[int, Pose]:
    root = moving_root(index, image.frame) if image.frame else None
    if root is None:
        if is_named:
            where = image.frame or "an unnamed frame"
            raise fail(index.path, "--topic poses", f"transforms do not tell how {where}, the camera's frame, moves")
        return {}
    if not is_named and root.rpartition("/")[2] not in _WORLDS:
        what = f"transforms move {image.frame} in {root}: not taken as poses, unless by --topic poses=/tf"
        report.note(index.path, "", what)
        return {}
    times_ns, poses = moving_poses(index, image.frame)
    if not len(poses):
        return {}
    report.note(index.path, "", f"poses are those of {image.frame} in {root} by the bag's transforms")
    return poses_at(times_s, times_ns / 1e9, poses, index.path, report)
