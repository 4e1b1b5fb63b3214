"""Training samples on disk: crops with their labels, drawn by several processes."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from meshslam.geometry.arrays import Bytes, Floats, Ints
from meshslam.perception.keypoints.crop import Crop, cut_out
from meshslam.simulation.cars import ProceduralCar, make_cars
from meshslam.training.degrade import cut, obstructed, seen
from meshslam.training.scene import draw_picture

LEAST_SHOWN = 0.30  # of the car's own pixels
LEAST_PX = 22  # of the mask's box
CHUNK = 200  # samples that one seed gives
CARS_A_CHUNK = 12


@dataclass(frozen=True, eq=False)
class Sample:
    """A crop and what is true of it."""

    cut: Bytes  # (HEIGHT_PX, WIDTH_PX, 4): BGR and mask
    keypoints: Floats  # (12, 2), px of the input
    visible: Floats  # (12,), 0 or 1
    angle_rad: float
    box_px: tuple[float, float]  # width and height of the mask's box, in px of the input


@dataclass(frozen=True, eq=False)
class Samples:
    """Many samples as arrays."""

    cuts: Bytes  # (N, HEIGHT_PX, WIDTH_PX, 4)
    keypoints: Floats  # (N, 12, 2)
    visible: Floats  # (N, 12)
    angles_rad: Floats  # (N,)
    boxes_px: Floats  # (N, 2)

    def __len__(self) -> int:
        return len(self.cuts)

    def chosen(self, rows: Ints) -> Samples:
        """Copies of the samples with these numbers."""
        return Samples(*(part[rows] for part in vars(self).values()))


def draw_sample(rng: np.random.Generator, cars: Sequence[ProceduralCar]) -> Sample:
    """Draw until enough of a car is seen."""
    while True:
        picture = cut(rng, obstructed(rng, draw_picture(rng, cars)))
        if picture.mask.sum() < LEAST_SHOWN * picture.whole_px or not picture.visible.any():
            continue
        found = seen(rng, picture)
        x, y, w, h = cv2.boundingRect(found.mask)
        if max(w, h) < LEAST_PX or min(w, h) < 6:
            continue
        crop = Crop.around((float(x), float(y), float(w), float(h)))
        return Sample(
            cut_out(found.image_bgr, found.mask, crop),
            crop.to_input(picture.keypoints),
            (picture.visible & picture.depth_step).astype(float),
            picture.viewing_angle_rad,
            (float(w * crop.scale[0]), float(h * crop.scale[1])),
        )


def draw_chunk(seed: int, count: int = CHUNK) -> Samples:
    """Draw `count` samples of cars and scenes that follow from the seed."""
    cv2.setNumThreads(1)
    rng = np.random.default_rng(seed)
    cars = make_cars(int(rng.integers(2**31)), CARS_A_CHUNK)
    return gathered([draw_sample(rng, cars) for _ in range(count)])


def gathered(samples: Sequence[Sample]) -> Samples:
    """Put samples together."""
    return Samples(
        np.stack([s.cut for s in samples]),
        np.stack([s.keypoints for s in samples]),
        np.stack([s.visible for s in samples]),
        np.array([s.angle_rad for s in samples]),
        np.array([s.box_px for s in samples]),
    )


def _save_chunk(job: tuple[int, Path]) -> Path:
    seed, path = job
    if not path.exists():
        chunk = draw_chunk(seed)
        part = path.with_suffix(".part.npz")
        np.savez(part, **{key: value for key, value in vars(chunk).items()})
        part.replace(path)
    return path


def draw_samples(
    folder: Path, seed: int, chunks: int, workers: int = 1, progress: Callable[[str, int, int], None] | None = None
) -> list[Path]:
    """Draw chunks of samples into a folder with `workers` processes; what is there is not drawn again."""
    folder.mkdir(parents=True, exist_ok=True)
    jobs = [(seed * 1_000_003 + i, folder / f"{seed}-{i:04d}.npz") for i in range(chunks)]
    done: list[Path] = []
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        for path in pool.imap(_save_chunk, jobs):
            done.append(path)
            if progress:
                progress("draw", len(done), chunks)
    return done


def load_samples(paths: Sequence[Path]) -> Samples:
    """Read chunks into memory."""
    parts = []
    for path in paths:
        with np.load(path) as archive:
            parts.append({key: archive[key] for key in archive.files})
    return Samples(**{key: np.concatenate([part[key] for part in parts]) for key in parts[0]})
