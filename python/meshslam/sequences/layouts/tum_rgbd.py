"""TUM RGB-D: rgb.txt with times and names of the images in rgb/, groundtruth.txt; the camera by --camera FILE."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshslam.geometry import Camera
from meshslam.sequences.cameras.read import read_camera
from meshslam.sequences.distortion import Distortion
from meshslam.sequences.folder import CameraFile
from meshslam.sequences.image_source import ImageFiles
from meshslam.sequences.images import image_bits, load_image, note_turn
from meshslam.sequences.layouts.timed_images import timed_images
from meshslam.sequences.loader import LoadOptions
from meshslam.sequences.pose_matching import all_or_some, poses_at
from meshslam.sequences.report import IncompleteError, Report, fail
from meshslam.sequences.sequence import Sequence
from meshslam.sequences.tum import read_tum

# fx, fy, cx, cy; k1, k2, p1, p2, k3 of the colour cameras, from the data set's page "File Formats"
_KNOWN = {
    "freiburg1": ((517.3, 516.5, 318.6, 255.3), (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)),
    "freiburg2": ((520.9, 521.0, 325.1, 249.7), (0.2312, -0.7849, -0.0033, -0.0001, 0.9172)),
    "freiburg3": ((535.4, 539.2, 320.1, 247.6), ()),
}
_SIZE = (640, 480)


@dataclass(frozen=True)
class TumRgbd:
    """Poses are the ground truth's, world_from_camera. Depth images are not used."""

    name: str = "tum-rgbd"
    looks_for: str = "a folder that holds rgb.txt and rgb"
    accepts: frozenset[str] = frozenset({"camera_file", "size", "conventions"})

    def recognizes(self, path: Path) -> bool:
        """By its list of images."""
        return (path / "rgb.txt").is_file()

    def image_files(self, path: Path, options: LoadOptions) -> list[Path]:
        """Those that rgb.txt names; see Loader."""
        return timed_images(path / "rgb.txt", path, None, Report())[1]

    def load(self, path: Path, options: LoadOptions, report: Report) -> Sequence:
        """Read all but the images; see Loader."""
        images = report.attempt(lambda: timed_images(path / "rgb.txt", path, None, report))
        if images is None:
            raise IncompleteError(f"{path}: nothing to load")
        times_s, files = images
        found = report.attempt(lambda: _camera(path, files[0], options, report))
        if found is None:
            raise IncompleteError(f"{path}: no camera")
        truth, poses = path / "groundtruth.txt", {}
        if options.has_own_poses and truth.exists():
            pose_times_s, read = read_tum(truth, report)
            poses = poses_at(times_s, pose_times_s, options.world_from_camera(read), truth, report)
        note_turn(files, report)
        every, some = all_or_some(poses, len(files))
        return Sequence(
            name=path.name,
            layout=self.name,
            root=path,
            camera=found.camera,
            frame_ids=tuple(range(len(files))),
            times_s=times_s,
            images=ImageFiles(tuple(files), image_bits(files, report)),
            world_from_camera=every,
            is_levelled=options.poses_convention != "first-camera-world",
            detections_path=options.detections_path,
            height_above_ground_m=found.height_above_ground_m,
            distortion=found.distortion,
            partial_poses=some,
        )


def _camera(path: Path, first_image: Path, options: LoadOptions, report: Report) -> CameraFile:
    """The given one, else the published one of the sensor that the folder is called after."""
    height, width = load_image(first_image).shape[:2]
    if options.camera_file is not None:
        return read_camera(options.camera_file, options.camera_number, options.size or (width, height), report)
    name = re.search(r"freiburg[123]", path.name)
    if name is None or (width, height) != _SIZE:
        raise fail(path, "", "TUM RGB-D holds no camera, and its name is none of freiburg1 to 3: give --camera FILE")
    intrinsics, coefficients = _KNOWN[name[0]]
    raw = Camera(width, height, *intrinsics)
    report.note(path, "", f"the camera is the published one of {name[0]}: --camera FILE gives another")
    lens = Distortion(raw, raw, np.array(coefficients)) if coefficients else None
    return CameraFile(raw if lens is None else lens.camera, lens)
