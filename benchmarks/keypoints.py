"""What the key point network gets wrong: by the size of the car, what hides it, and how good its mask is.

    .venv/bin/python benchmarks/keypoints.py [--model FILE] [--chunks 5] [--seed 7]

On drawn cars and scenes that no training with another seed has seen.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np

from meshslam.perception.keypoints.crop import to_input
from meshslam.perception.keypoints.finder import KeypointConfig, KeypointFinder
from meshslam.perception.keypoints.mirror import answers_of
from meshslam.training.dataset import Sample, enough_is_seen, gathered, labelled
from meshslam.training.degrade import cut, obstructed, seen
from meshslam.training.pictures import CHUNK, Album, draw_chunk
from meshslam.training.scene import Picture
from meshslam.training.score import score


@dataclass(frozen=True)
class Kind:
    """What makes a sample easy or hard."""

    size_px: float  # longer side of the car's box in the picture
    cut: bool
    shown: float  # share of the car's pixels that nothing hides
    mask_iou: float  # the segmenter's mask against the pixels that are seen
    brightness: float  # mean over the car, 0 to 255


def groups(kinds: Sequence[Kind]) -> dict[str, np.ndarray]:
    """Which samples (N,) are of each kind."""
    size_px, part, shown, iou, brightness = np.array([astuple(kind) for kind in kinds]).T
    whole = part == 0
    return {
        "all": size_px > 0,
        "under 30 px": size_px < 30,
        "30 to 60 px": (size_px >= 30) & (size_px < 60),
        "60 px and more": size_px >= 60,
        "cut by the image": ~whole,
        "30 to 70% shown": whole & (shown < 0.7),
        "70 to 90% shown": whole & (shown >= 0.7) & (shown < 0.9),
        "mask IoU under 0.7": iou < 0.7,
        "mask IoU 0.7 to 0.8": (iou >= 0.7) & (iou < 0.8),
        "mask IoU 0.8 and more": iou >= 0.8,
        "dark": brightness < 40,
        "whole, mask IoU 0.8 and more": whole & (shown >= 0.7) & (iou >= 0.8),
    }


def drawn(rng: np.random.Generator, picture: Picture) -> tuple[Sample, Kind] | None:
    """A sample as for training, and its kind."""
    covered = obstructed(rng, picture)
    part = cut(rng, covered)
    if not enough_is_seen(part):
        return None
    found = seen(rng, part)
    sample = labelled(found, part)
    mask = found.mask > 0
    own = part.mask
    kind = Kind(
        float(max(np.ptp(np.argwhere(own), axis=0) + 1)),
        part is not covered,
        float(own.sum() / part.whole_px),
        float((mask & own).sum() / (mask | own).sum()),
        float(found.image_bgr[own].mean()),
    )
    return None if sample is None else (sample, kind)


def answers(model: str | None, cuts: np.ndarray) -> list[np.ndarray]:
    """What the network says of crops."""
    finder = KeypointFinder(KeypointConfig(model=model))
    parts = [answers_of(finder.answers, to_input(cuts[i : i + 64])) for i in range(0, len(cuts), 64)]
    return [np.concatenate(part) for part in zip(*parts, strict=True)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path)
    parser.add_argument("--chunks", type=int, default=5)
    parser.add_argument("--size", type=int, default=CHUNK, help="pictures of a chunk")
    parser.add_argument("--seed", type=int, default=7)
    a = parser.parse_args()
    pairs = []
    for chunk in range(a.chunks):
        album = Album(draw_chunk(1_000_003 * a.seed + chunk, a.size))
        rng = np.random.default_rng([a.seed, chunk])
        pairs += [pair for i in range(len(album)) if (pair := drawn(rng, album[i])) is not None]
    samples, kinds = gathered([sample for sample, _ in pairs]), [kind for _, kind in pairs]
    found = answers(None if a.model is None else str(a.model), samples.cuts)
    print("| crops | number | PCK@0.1 | median error | angle, median | wrong way round |\n" + "| --- " * 6 + "|")
    for name, chosen in groups(kinds).items():
        rows = np.flatnonzero(chosen)
        if len(rows):
            s = score(*(part[rows] for part in found), samples.chosen(rows))
            figures = (
                f"{s.pck:.3f} | {100 * s.error_median_share:.1f}% | {s.angle_median_deg:.1f}° | {100 * s.flips:.1f}%"
            )
            print(f"| {name} | {len(rows)} | {figures} |")


if __name__ == "__main__":
    main()
