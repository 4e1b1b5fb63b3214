"""One camera from a calibration file of any of these formats, which is told by its content."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.sequences.cameras import colmap
from meshslam.sequences.cameras.basalt import Basalt
from meshslam.sequences.cameras.camodocal import Camodocal
from meshslam.sequences.cameras.euroc import Euroc
from meshslam.sequences.cameras.found import CameraFormat, FoundCamera, camera_file
from meshslam.sequences.cameras.kalibr import Kalibr
from meshslam.sequences.cameras.kitti_rectified import read_rectified, rectified_cameras
from meshslam.sequences.cameras.opencv_storage import OpencvStorage
from meshslam.sequences.cameras.orb_slam import OrbSlam
from meshslam.sequences.cameras.ros_info import RosInfo
from meshslam.sequences.cameras.vins import VinsFusion
from meshslam.sequences.folder import CameraFile, read_camera_file
from meshslam.sequences.report import Report, fail
from meshslam.sequences.text import read_text, yaml_mapping

FORMATS: tuple[CameraFormat, ...] = (  # asked in this order
    Kalibr(),
    Basalt(),
    OrbSlam(),
    VinsFusion(),
    Camodocal(),
    Euroc(),
    RosInfo(),
    OpencvStorage(),
)
_LARGEST_BYTES = 4 << 20
_FORMATS_IN_WORDS = (
    "our camera.yaml, Kalibr's camchain, ROS' camera_info, OpenCV's FileStorage, EuRoC's sensor.yaml, ORB-SLAM's "
    "settings, VINS' configuration, camodocal's, Basalt's JSON, KITTI-360's perspective.txt, COLMAP's cameras"
)
Reader = Callable[[Report], FoundCamera]


def read_camera(
    path: Path, number: int | None = None, size: tuple[int, int] | None = None, report: Report | None = None
) -> CameraFile:
    """Read one camera from a calibration file, whose format is told by its content (docs/cameras.md).

    Of several cameras `number` chooses one. `size` is that of the images, (width, height) px: intrinsics of another
    size are scaled. SequenceError for a file of no known format, several cameras without a number, a size of another
    aspect, or a lens model that we do not have; what was chosen or scaled is noted in `report`.

    Example:
        found = read_camera(Path("camchain.yaml"), number=0, size=(752, 480))
        found.camera, found.distortion, found.imu_from_camera

    """
    report = Report() if report is None else report
    data = _data(path)
    if path.suffix == ".bin" or b"\0\0" in data[:8]:
        rows = colmap.from_binary(path, data)
        if not rows:
            raise fail(path, "", "holds no cameras")
        return _chosen(path, _colmap_readers(path, rows), number, size, report)
    text = read_text(path)
    rectified = rectified_cameras(text)
    if rectified:
        return _chosen(path, _rectified_readers(path, rectified), number, size, report)
    rows = colmap.from_text(path, text)
    if rows:
        return _chosen(path, _colmap_readers(path, rows), number, size, report)
    content = _xml(path, text) if text.lstrip().startswith("<") else yaml_mapping(path, text)
    return _of_mapping(path, content, number, size, report)


def _of_mapping(
    path: Path, content: Mapping[str, Any], number: int | None, size: tuple[int, int] | None, report: Report
) -> CameraFile:
    for known in FORMATS:
        names = known.cameras(content)
        if names:
            readers = {n: (name, partial(known.read, path, content, n)) for n, name in names.items()}
            return _chosen(path, readers, number, size, report)
    if content.keys() & {"model", "resolution", "intrinsics"}:
        return _own(path, number, size, report)
    raise fail(path, "", f"no known calibration file; known are {_FORMATS_IN_WORDS}")


def _own(path: Path, number: int | None, size: tuple[int, int] | None, report: Report) -> CameraFile:
    """Our camera.yaml; at another size, its raw camera is scaled."""
    _one_camera(path, number)
    found = read_camera_file(path, Report())
    lens = found.distortion
    raw = found.camera if lens is None else lens.raw_camera
    if size is None or size == (raw.width, raw.height):
        return read_camera_file(path, report)
    given = FoundCamera(
        (raw.width, raw.height),
        np.array([raw.fx, raw.fy, raw.cx, raw.cy, raw.skew]),
        "none" if lens is None else lens.model,
        np.zeros(0) if lens is None else lens.coefficients,
        imu_from_camera=found.imu_from_camera,
    )
    scaled = camera_file(path, given, size, report)
    return CameraFile(scaled.camera, scaled.distortion, found.imu_from_camera, found.height_above_ground_m)


def _one_camera(path: Path, number: int | None) -> None:
    if number not in (None, 0):
        raise fail(path, "", f"holds one camera: leave out the camera number {number}")


def _chosen(
    path: Path,
    readers: Mapping[int, tuple[str, Reader]],
    number: int | None,
    size: tuple[int, int] | None,
    report: Report,
) -> CameraFile:
    """The camera of that number, or the only one; FoundError, naming all, where it is not clear which."""
    listed = ", ".join(f"{n} ({name})" for n, (name, _) in sorted(readers.items())[:12])
    if number is None and len(readers) > 1:
        raise fail(path, "", f"holds {len(readers)} cameras: choose one by its number, --camera N: {listed}"[:250])
    chosen = next(iter(readers)) if number is None else number
    if chosen not in readers:
        raise fail(path, "", f"holds no camera {chosen}, only {listed}"[:250])
    return camera_file(path, readers[chosen][1](report), size, report)


def _colmap_readers(path: Path, rows: Mapping[int, colmap.ColmapCamera]) -> dict[int, tuple[str, Reader]]:
    return {n: (row.model, partial(colmap.to_found, path, row)) for n, row in rows.items()}


def _rectified_readers(path: Path, names: Mapping[int, str]) -> dict[int, tuple[str, Reader]]:
    return {n: (name, partial(read_rectified, path, n)) for n, name in names.items()}


def _data(path: Path) -> bytes:
    try:
        size = path.stat().st_size
        if size > _LARGEST_BYTES:
            raise fail(path, "", f"is {size >> 20} MB large: no calibration file")
        return path.read_bytes()
    except FileNotFoundError:
        raise fail(path, "", "no such file") from None
    except OSError as error:
        raise fail(path, "", f"cannot be read: {error.strerror}") from None


def _xml(path: Path, text: str) -> dict[str, Any]:
    """An OpenCV FileStorage in XML as its YAML would be read; no entities, which can grow without bounds."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise fail(path, "", "XML with a DOCTYPE or entities is not read: OpenCV writes none")
    try:
        root = ET.fromstring(text)  # without entities
    except ET.ParseError as error:
        raise fail(path, "", f"not valid XML: {str(error)[:120]}") from None
    if root.tag != "opencv_storage":
        raise fail(path, "", f"expected <opencv_storage>, found <{root.tag[:40]}>")
    try:
        return {str(part.tag): _xml_value(part) for part in root}
    except RecursionError:
        raise fail(path, "", "not valid XML: nested too deeply") from None


def _xml_value(part: ET.Element) -> object:
    if len(part):
        return {str(inner.tag): _xml_value(inner) for inner in part}
    words = (part.text or "").replace('"', " ").split()
    return words[0] if len(words) == 1 and part.tag != "data" else words
