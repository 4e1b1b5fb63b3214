"""A recording of any layout as a sequence folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from meshslam.errors import SequenceError
from meshslam.geometry import Bytes
from meshslam.sequences.folder_writer import write_sequence_folder
from meshslam.sequences.sequence import Sequence


def copy_as_folder(recording: Sequence, folder: Path, step: Callable[[int, int], None]) -> tuple[str, ...]:
    """Write a recording's frames, camera, poses and IMU into `folder`, image by image; what is not taken is returned.

    Images are written as its camera took them, with the camera's distortion. `step` is told after each how many of all
    are done. SequenceError for an image that cannot be read, and where there are none.
    """
    if recording.images is None:
        raise SequenceError(f"{recording.root}: the recording has no images, only detections: nothing to convert")
    write_sequence_folder(
        folder,
        recording.camera,
        recording.times_s,
        images=_images(recording, step),
        world_from_camera=recording.world_from_camera,
        partial_poses=recording.partial_poses,
        frame_ids=recording.frame_ids,
        imu=recording.imu,
        imu_from_camera=recording.imu_from_camera,
        initial_state=recording.initial_state,
        height_above_ground_m=recording.height_above_ground_m,
        distortion=recording.distortion,
    )
    return tuple(_left_out(recording))


def _images(recording: Sequence, step: Callable[[int, int], None]) -> Iterator[Bytes]:
    raw, images = recording.raw_camera, recording.images
    for index in range(len(recording)):
        if images is not None:
            yield images.read(index, (raw.width, raw.height))
        step(index + 1, len(recording))


def _left_out(recording: Sequence) -> Iterator[str]:
    if recording.detections_path is not None:
        yield f"{recording.detections_path}: detections are not copied: give --detections FILE to later commands"
    if not recording.is_levelled:
        yield f"{recording.root}: poses' z is the first camera's up, not level, which a sequence folder cannot say"
