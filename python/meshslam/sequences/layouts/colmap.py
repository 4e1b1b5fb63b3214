"""A COLMAP project: images/ with sparse/0 or sparse: cameras and images, text or binary."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from meshslam.geometry import Pose
from meshslam.sequences.cameras.read import read_camera
from meshslam.sequences.colmap_images import by_file_name, read_colmap_images
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
        _note_others(path, images, report)
        placed = _on_disk(path / "images", images)
        ids = {camera for _, camera in placed.values()}
        number = options.camera_number if options.camera_number is not None else ids.pop() if len(ids) == 1 else None
        if number is None:
            names = ", ".join(map(str, sorted(ids)[:8]))
            raise fail(images, "", f"the images are of the cameras {names}: choose one by --camera N")
        found = read_camera(cameras, number, report=report)
        files = _of_camera(placed, number)
        if not files:
            names = ", ".join(map(str, sorted(ids)[:8]))
            raise fail(images, "", f"no image is of the camera {number}, they are of {names}: choose one by --camera N")
        frame_ids = _numbers(files)
        known = {
            i: WORLD_FROM_FIRST_CAMERA @ placed[file][0].inverse()
            for i, file in enumerate(files)
            if file in placed and options.has_own_poses
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


def _note_others(path: Path, images: Path, report: Report) -> None:
    """COLMAP writes a model for each part that it could not join; the first need not be the largest."""
    models = [p for p in sorted((path / "sparse").glob("[0-9]*")) if (p / images.name).is_file()]
    if images.parent in models and len(models) > 1:
        names = ", ".join(model.name for model in models[:8])
        said = (
            f"COLMAP made {len(models)} models ({names}), {images.parent.name} is read: keep another alone in sparse/"
        )
        report.note(path / "sparse", "", said)


def _on_disk(folder: Path, images: Path) -> dict[Path, tuple[Pose, int]]:
    """camera_from_world and the camera of the model's images that are there: by their names, else without folders."""
    placed = read_colmap_images(images)
    inside = {n: v for n, v in placed.items() if ".." not in n.split("/") and not n.startswith("/")}
    there = {folder / name: value for name, value in inside.items() if (folder / name).is_file()}
    if not there:
        there = {folder / n: v for n, v in by_file_name(images, inside).items() if (folder / n).is_file()}
    if not there:
        first = next(iter(placed))[-60:]
        raise fail(
            images, "", f"none of its {len(placed)} images, such as {first}, is in {folder}: is it another's model?"
        )
    return there


def _of_camera(placed: Mapping[Path, tuple[Pose, int]], number: int) -> list[Path]:
    """The camera's images, and those beside them that have no pose, in order."""
    folders = sorted({path.parent for path, (_, camera) in placed.items() if camera == number})
    listed = [file for folder in folders for file in list_images(folder)]
    return [file for file in listed if file not in placed or placed[file][1] == number]


def _numbers(files: list[Path]) -> tuple[int, ...]:
    numbers = frame_numbers(files) if are_numbered(files) and len({f.parent for f in files}) == 1 else ()
    return numbers or tuple(range(len(files)))
