"""Drawn pictures on disk: what is costly of a training sample is drawn once, by several processes."""

from __future__ import annotations

import io
import multiprocessing
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from meshslam.errors import ModelError
from meshslam.files import remove_leftovers_of, write_atomically
from meshslam.geometry import Bools, Bytes, Floats, Ints
from meshslam.simulation import ProceduralCar, make_cars, make_fleet
from meshslam.training.dataset import Sample, Samples, gathered, taken
from meshslam.training.scene import Picture, draw_picture

Kind = Literal["cars", "fleet"]
Maker = Callable[[int, int], list[ProceduralCar]]  # from a seed and a number

CHUNK = 400  # pictures that one seed gives
CARS_A_CHUNK = 16
_MAKERS: dict[Kind, Maker] = {"cars": make_cars, "fleet": make_fleet}
_FIRST: dict[Kind, int] = {"cars": 0, "fleet": 500_000}  # of a seed's chunks
_BRIGHTEST = 3.0  # of the light that is kept; a byte holds its square root
_LIGHT = (_BRIGHTEST * np.square(np.arange(256) / 255)).astype(np.float32)
_CAR, _OTHER = 1, 2


@dataclass(frozen=True, eq=False)
class ImageFeatures:
    """Many pictures as arrays, their pixels in one row."""

    pixels: Bytes  # (pixels of all, 4): roots of blue, green, red, and whose pixel it is
    sizes: Ints  # (N, 2), height and width
    whole_px: Ints  # (N,)
    keypoints: Floats  # (N, 12, 2), px
    visible: Bools  # (N, 12)
    angles_rad: Floats  # (N,)

    def __len__(self) -> int:
        return len(self.sizes)

    def starts(self) -> Ints:
        """Where each picture's pixels start, (N,)."""
        areas = self.sizes.prod(1)
        starts: Ints = np.cumsum(areas) - areas
        return starts


class Album:
    """Pictures by number."""

    def __init__(self, pictures: ImageFeatures) -> None:
        self._pictures, self._starts = pictures, pictures.starts()

    def __len__(self) -> int:
        return len(self._pictures)

    def __getitem__(self, i: int) -> Picture:
        p, start = self._pictures, self._starts[i]
        height, width = p.sizes[i]
        part = p.pixels[start : start + height * width].reshape(height, width, 4)
        return Picture(
            _LIGHT[part[..., :3]],
            part[..., 3] == _CAR,
            part[..., 3] == _OTHER,
            int(p.whole_px[i]),
            p.keypoints[i],
            p.visible[i],
            float(p.angles_rad[i]),
        )


def samples_of(rng: np.random.Generator, album: Album, rows: Iterable[int]) -> Samples:
    """Take a sample of each of these pictures, or of another one where too little of its car is left to be seen."""
    return gathered([_sample_of(rng, album, int(row)) for row in rows])


def _sample_of(rng: np.random.Generator, album: Album, row: int) -> Sample:
    while (sample := taken(rng, album[row])) is None:
        row = int(rng.integers(len(album)))
    return sample


def draw_pictures(rng: np.random.Generator, cars: Sequence[ProceduralCar], count: int) -> list[Picture]:
    """Draw pictures of which a sample can be taken."""
    found: list[Picture] = []
    while len(found) < count:
        picture = draw_picture(rng, cars)
        if taken(rng, picture) is not None:
            found.append(picture)
    return found


def packed(pictures: Sequence[Picture]) -> ImageFeatures:
    """Put pictures together."""
    return ImageFeatures(
        np.concatenate([_pixels(p).reshape(-1, 4) for p in pictures]),
        np.array([p.mask.shape for p in pictures]),
        np.array([p.whole_px for p in pictures]),
        np.stack([p.keypoints for p in pictures]),
        np.stack([p.visible for p in pictures]),
        np.array([p.viewing_angle_rad for p in pictures]),
    )


def _pixels(picture: Picture) -> Bytes:
    root = np.sqrt(np.clip(picture.image_bgr, 0, _BRIGHTEST) / _BRIGHTEST)
    whose = np.where(picture.mask, _CAR, np.where(picture.others, _OTHER, 0))
    return np.dstack([np.round(255 * root), whose]).astype(np.uint8)


def draw_chunk(seed: int, count: int = CHUNK, cars: int = CARS_A_CHUNK, make: Maker = make_cars) -> ImageFeatures:
    """Draw `count` pictures of cars, or of what else `make` makes, and of scenes that follow from the seed."""
    cv2.setNumThreads(1)
    rng = np.random.default_rng(seed)
    return packed(draw_pictures(rng, make(int(rng.integers(2**31)), cars), count))


def draw_samples(seed: int, count: int, make: Maker = make_cars) -> Samples:
    """Draw `count` samples of cars, or of what else `make` makes, that follow from the seed."""
    album = Album(draw_chunk(seed, count, make=make))
    return samples_of(np.random.default_rng(seed), album, range(count))


def _save_chunk(job: tuple[int, Path, int, Kind]) -> Path:
    seed, path, count, kind = job
    if not path.exists():
        chunk = draw_chunk(seed, count, make=_MAKERS[kind])
        remove_leftovers_of(path)
        buffer = io.BytesIO()
        np.savez(buffer, **vars(chunk))
        write_atomically(path, buffer.getvalue(), ModelError)
    return path


def draw_chunks(
    folder: Path,
    seed: int,
    chunks: int,
    size: int = CHUNK,
    workers: int = 1,
    progress: Callable[[str, int, int], None] | None = None,
    kind: Kind = "cars",
) -> list[Path]:
    """Draw chunks of pictures into a folder with `workers` processes; what is there is not drawn again."""
    folder.mkdir(parents=True, exist_ok=True)
    first, name = seed * 1_000_003 + _FIRST[kind], f"{seed}-{size}" + ("" if kind == "cars" else f"-{kind}")
    jobs = [(first + i, folder / f"{name}-{i:04d}.npz", size, kind) for i in range(chunks)]
    done: list[Path] = []
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        for path in pool.imap(_save_chunk, jobs):
            done.append(path)
            if progress:
                progress(f"draw {kind}", len(done), chunks)
    return done


def load_album(paths: Sequence[Path]) -> Album:
    """Read chunks into memory."""
    parts = []
    for path in paths:
        with np.load(path) as archive:
            parts.append({key: archive[key] for key in archive.files})
    return Album(ImageFeatures(**{key: np.concatenate([part[key] for part in parts]) for key in parts[0]}))
