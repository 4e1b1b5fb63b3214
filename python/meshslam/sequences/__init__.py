"""Recordings on disk as sequences: one loader a layout behind one registry; the sequence folder's reader and writer."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.sequences.bags.camera import camera_of_info, is_rectified_topic
    from meshslam.sequences.bags.decoding import frame_of, stamp_ns
    from meshslam.sequences.bags.pixels import bits_of, image_of, is_depth
    from meshslam.sequences.cameras.read import read_camera
    from meshslam.sequences.check import check_sequence, inspect_sequence
    from meshslam.sequences.conventions import CONVENTIONS, WORLD_FROM_FIRST_CAMERA, Convention, in_convention
    from meshslam.sequences.copying import copy_as_folder
    from meshslam.sequences.distortion import Distortion, undistorted
    from meshslam.sequences.folder import CameraFile, read_camera_file
    from meshslam.sequences.folder_writer import camera_yaml, write_sequence_folder
    from meshslam.sequences.image_source import ImageFiles, ImageSource
    from meshslam.sequences.imu_files import read_imu
    from meshslam.sequences.lenses import LensModel
    from meshslam.sequences.loader import Loader, LoadOptions
    from meshslam.sequences.mounting_files import read_camera_from_body, read_extrinsics, with_imu
    from meshslam.sequences.opening import RecordingOptions
    from meshslam.sequences.path_files import PathFile, read_path, read_path_file
    from meshslam.sequences.registry import LOADERS, find_loader, open_sequence, open_with
    from meshslam.sequences.report import Problem, Progress, Report, no_progress
    from meshslam.sequences.selection import TOPICS, read_seconds, read_selection, read_size, read_topics
    from meshslam.sequences.sequence import ImuSamples, InitialState, Sequence
    from meshslam.sequences.text import LARGEST, parsed_yaml
    from meshslam.sequences.tum import format_tum, read_tum
    from meshslam.sequences.turning import turns
else:
    __getattr__ = deferred(
        __name__,
        {
            "bags.camera": "camera_of_info is_rectified_topic",
            "bags.decoding": "frame_of stamp_ns",
            "bags.pixels": "bits_of image_of is_depth",
            "cameras.read": "read_camera",
            "check": "check_sequence inspect_sequence",
            "conventions": "CONVENTIONS WORLD_FROM_FIRST_CAMERA Convention in_convention",
            "copying": "copy_as_folder",
            "distortion": "Distortion undistorted",
            "folder": "CameraFile read_camera_file",
            "folder_writer": "camera_yaml write_sequence_folder",
            "image_source": "ImageFiles ImageSource",
            "imu_files": "read_imu",
            "lenses": "LensModel",
            "loader": "Loader LoadOptions",
            "mounting_files": "read_camera_from_body read_extrinsics with_imu",
            "opening": "RecordingOptions",
            "path_files": "PathFile read_path read_path_file",
            "registry": "LOADERS find_loader open_sequence open_with",
            "report": "Problem Progress Report no_progress",
            "selection": "TOPICS read_seconds read_selection read_size read_topics",
            "sequence": "ImuSamples InitialState Sequence",
            "text": "LARGEST parsed_yaml",
            "tum": "format_tum read_tum",
            "turning": "turns",
        },
    )

__all__ = [
    "CONVENTIONS",
    "LARGEST",
    "LOADERS",
    "TOPICS",
    "WORLD_FROM_FIRST_CAMERA",
    "CameraFile",
    "Convention",
    "Distortion",
    "ImageFiles",
    "ImageSource",
    "ImuSamples",
    "InitialState",
    "LensModel",
    "LoadOptions",
    "Loader",
    "PathFile",
    "Problem",
    "Progress",
    "RecordingOptions",
    "Report",
    "Sequence",
    "bits_of",
    "camera_of_info",
    "camera_yaml",
    "check_sequence",
    "copy_as_folder",
    "find_loader",
    "format_tum",
    "frame_of",
    "image_of",
    "in_convention",
    "inspect_sequence",
    "is_depth",
    "is_rectified_topic",
    "no_progress",
    "open_sequence",
    "open_with",
    "parsed_yaml",
    "read_camera",
    "read_camera_file",
    "read_camera_from_body",
    "read_extrinsics",
    "read_imu",
    "read_path",
    "read_path_file",
    "read_seconds",
    "read_selection",
    "read_size",
    "read_topics",
    "read_tum",
    "stamp_ns",
    "turns",
    "undistorted",
    "with_imu",
    "write_sequence_folder",
]
