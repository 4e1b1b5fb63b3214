"""A COLMAP project: images/ with sparse/0 or sparse: cameras and images, text or binary."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from meshslam.sequences.cameras.read import read_camera
from meshslam.sequences.colmap_images import read_colmap_images
from meshslam.sequences.conventions import WORLD_FROM_FIRST_CAMERA
from meshslam.sequences.image_source import ImageFiles
from meshslam.sequences.images import are_numbered, frame_numbers, image_bits, list_images, note_turn
from meshslam.sequences.layouts.frames import frame_times
from meshslam.sequences.loader import LoadOptions
from meshslam.sequences.pose_matching import all_or_some
from meshslam.sequences.report import Report, fail
from meshslam.sequences.sequence import Sequence


@dataclass(frozen=True)
class Colmap:
    """Poses are the model's: of any scale, their axes renamed as those of a first camera; images of one camera."""

    name: str = "colmap"
    looks_for: str = "a folder that holds images and sparse/0 with cameras and images"
    accepts: frozenset[str] = frozenset({"rate_hz", "times_file"})

    def recognizes(self, path: Path) -> bool:
        """By its model."""
        return (path / "images").is_dir() and _model(path) is not None

    def image_files(self, path: Path, options: LoadOptions) -> list[Path]:
        """Everything in images/; see Loader."""
        return list_images(path / "images")

    def load(self, path: Path, options: LoadOptions, report: Report) -> Sequence:
        """Read the model; see Loader."""
        model = _model(path)
        if model is None:
            raise fail(path, "", "holds no sparse/0 with COLMAP's cameras and images, .txt or .bin")
        cameras, images = model
        listed = list_images(path / "images")
        placed = read_colmap_images(images)
        ids = {placed[file.name][1] for file in listed if file.name in placed}
        if not ids:
            raise fail(images, "", f"no image of it is in images/, such as {listed[0].name}")
        number = options.camera_number if options.camera_number is not None else ids.pop() if len(ids) == 1 else None
        if number is None:
            names = ", ".join(map(str, sorted(ids)[:8]))
            raise fail(images, "", f"the images are of the cameras {names}: choose one by --camera N")
        found = read_camera(cameras, number, report=report)
        files = [file for file in listed if placed.get(file.name, (None, number))[1] == number]
        frame_ids = frame_numbers(files) if are_numbered(files) else tuple(range(len(files)))
        known = {
            i: WORLD_FROM_FIRST_CAMERA @ placed[file.name][0].inverse()
            for i, file in enumerate(files)
            if file.name in placed and options.has_own_poses
        }
        if 0 < len(known) < len(files):
            report.note(
                images, "", f"{len(files) - len(known)} of {len(files)} images have no pose: map leaves them out"
            )
        note_turn(files, report)
        every, some = all_or_some(known, len(files))
        return Sequence(
            name=path.name,
            layout=self.name,
            root=path,
            camera=found.camera,
            frame_ids=frame_ids,
            times_s=frame_times(path / "images", files, frame_ids, options, report),
            images=ImageFiles(tuple(files), image_bits(files, report)),
            world_from_camera=every,
            is_levelled=False,
            detections_path=options.detections_path,
            distortion=found.distortion,
            partial_poses=some,
        )


def _model(path: Path) -> tuple[Path, Path] | None:
    """The files of cameras and images."""
    for folder in (path / "sparse" / "0", path / "sparse", path):
        for suffix in (".bin", ".txt"):
            cameras, images = folder / f"cameras{suffix}", folder / f"images{suffix}"
            if cameras.is_file() and images.is_file():
                return cameras, images
    return None
