"""What the key point network gets wrong: by the size of the car, what hides it, and how good its mask is.

    .venv/bin/python benchmarks/keypoints.py [--model FILE] [--chunks 5] [--seed 7] [--vehicles cars vans unseen]

On drawn vehicles and scenes that no training with another seed has seen. `unseen` are vans of body types that the
training does not draw. The second table is the reliability of the scores: of the key points with such scores, how many
are seen and found. The third is that of the viewing angles: the more mass they give to the other side, the more often
front is taken for rear.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from meshslam.categories import CarShape, Van, draw_bus, draw_car, draw_of_van, draw_truck, draw_van
from meshslam.categories.procedural.heavy import NONE
from meshslam.categories.procedural.heavy import Body as Measures
from meshslam.perception.keypoints.crop import to_input
from meshslam.perception.keypoints.decode import (
    angle_distribution,
    keypoint_scores,
    peak_angle,
    points_in_input,
    reversed_share,
)
from meshslam.perception.keypoints.finder import KeypointConfig, KeypointFinder
from meshslam.perception.keypoints.mirror import answers_of
from meshslam.simulation import ProceduralCar, meshed_cars
from meshslam.simulation.cars import Kind as Family
from meshslam.training.dataset import Sample, Samples, enough_is_seen, gathered, labelled
from meshslam.training.degrade import cut, obstructed, seen
from meshslam.training.pictures import CHUNK, Album, draw_chunk
from meshslam.training.scene import Picture
from meshslam.training.score import PCK_SHARE, score

CONFIDENT = 0.4
REVERSED_MASS = (0.0, 0.01, 0.05, 0.15, 0.3, 1.0)
UNSEEN = (  # body types that VANS do not hold
    Van(Measures(1, "panel", (6.00, 0.30), (2.10, 0.05), (2.85, 0.12), (3.60, 0.25), (0.85, 0.06), (0.40, 0.06),
                 (1.42, 0.06), (0.35, 0.05), NONE, NONE, (0.36, 0.01), (0.36, 0.03)),
        (0.20, 0.03), (0.36, 0.04), (0.01, 0.01)),  # step van
    Van(Measures(1, "panel", (3.40, 0.05), (1.48, 0.01), (1.90, 0.04), (2.42, 0.06), (0.50, 0.05), (0.35, 0.05),
                 (1.10, 0.04), (0.50, 0.05), NONE, NONE, (0.27, 0.01), (0.20, 0.02)),
        (0.12, 0.02), (0.40, 0.03), (0.05, 0.02)),  # kei van
    Van(Measures(1, "panel", (5.55, 0.25), (2.01, 0.02), (2.10, 0.05), (3.48, 0.10), (0.95, 0.04), (1.22, 0.06),
                 (1.25, 0.04), (0.60, 0.06), NONE, NONE, (0.37, 0.01), (0.30, 0.03)),
        (0.14, 0.02), (0.50, 0.03), (0.22, 0.04)),  # American full-size van
    Van(Measures(1, "panel", (4.28, 0.05), (1.72, 0.02), (1.94, 0.03), (2.40, 0.04), (1.00, 0.05), (0.08, 0.02),
                 (1.18, 0.04), (0.30, 0.05), NONE, NONE, (0.33, 0.01), (0.24, 0.02)),
        (0.20, 0.02), (0.38, 0.03), (0.20, 0.03)),  # early rear-engine van
)  # fmt: skip


def drawn_unseen(rng: np.random.Generator) -> CarShape:
    return draw_of_van(UNSEEN[int(rng.integers(len(UNSEEN)))], rng)


VEHICLES: dict[str, tuple[Family, Callable[[np.random.Generator], CarShape]]] = {
    "cars": ("car", draw_car),
    "vans": ("van", draw_van),
    "unseen": ("van", drawn_unseen),
    "trucks": ("truck", draw_truck),
    "buses": ("bus", draw_bus),
}


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


def maker(vehicles: str) -> Callable[[int, int], list[ProceduralCar]]:
    """What draws a number of such vehicles from a seed."""
    family, draw = VEHICLES[vehicles]

    def make(seed: int, count: int) -> list[ProceduralCar]:
        rng = np.random.default_rng(seed)
        return meshed_cars([draw(rng) for _ in range(count)], family)

    return make


def drawn_samples(vehicles: str, seed: int, chunks: int, size: int) -> tuple[Samples, list[Kind]]:
    """Samples of drawn vehicles, and of what kind each of them is."""
    pairs = []
    for chunk in range(chunks):
        album = Album(draw_chunk(1_000_003 * seed + chunk, size, make=maker(vehicles)))
        rng = np.random.default_rng([seed, chunk])
        pairs += [pair for i in range(len(album)) if (pair := drawn(rng, album[i])) is not None]
    return gathered([sample for sample, _ in pairs]), [kind for _, kind in pairs]


def scored_points(found: Sequence[np.ndarray], samples: Samples) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Scores (N, 12), which points are within `PCK_SHARE` of the truth, and which are visible."""
    points, share = points_in_input(found[0])
    scores = keypoint_scores(share, found[1], angle_distribution(found[3]))
    off = np.linalg.norm(points - samples.keypoints, axis=2) / samples.boxes_px.max(1)[:, None]
    return scores, off <= PCK_SHARE, samples.visible > 0


def print_groups(found: Sequence[np.ndarray], samples: Samples, kinds: Sequence[Kind]) -> None:
    scores, near, visible = scored_points(found, samples)
    head = ("crops", "number", "PCK@0.1", "median error", "angle, median", "wrong way round")
    head += ("score > 0.4: right of the visible", "of all", "visible ones with such a score")
    print("| " + " | ".join(head) + " |\n" + "| --- " * len(head) + "|")
    for name, chosen in groups(kinds).items():
        rows = np.flatnonzero(chosen)
        if len(rows):
            s = score(*(part[rows] for part in found), samples.chosen(rows))
            sure, good, seen_here = scores[rows] > CONFIDENT, near[rows], visible[rows]
            figures = (
                f"{s.pck:.3f} | {100 * s.error_median_share:.1f}% | {s.angle_median_deg:.1f}° | {100 * s.flips:.1f}%"
                f" | {good[sure & seen_here].mean():.3f} | {(good & seen_here)[sure].mean():.3f}"
                f" | {sure[seen_here].mean():.3f}"
            )
            print(f"| {name} | {len(rows)} | {figures} |")


def reliability(found: Sequence[np.ndarray], samples: Samples) -> np.ndarray:
    """Rows (B, 3) of the scores' tenths that occur: points, their mean score, and the share that is seen and found."""
    scores, near, visible = scored_points(found, samples)
    tenth = np.minimum((10 * scores).astype(int), 9)
    chosen = [tenth == i for i in range(10) if (tenth == i).any()]
    return np.array([(part.sum(), scores[part].mean(), (near & visible)[part].mean()) for part in chosen])


def print_reliability(found: Sequence[np.ndarray], samples: Samples) -> None:
    print("| points | mean score | right |\n| --- | --- | --- |")
    for count, score_mean, right in reliability(found, samples):
        print(f"| {count:.0f} | {score_mean:.3f} | {right:.3f} |")


def print_reversed(found: Sequence[np.ndarray], samples: Samples) -> None:
    """The viewing angles' mass on the other side against how many are reversed."""
    shares = angle_distribution(found[3])
    mass = reversed_share(shares)
    turned = np.abs(np.angle(np.exp(1j * (peak_angle(shares) - samples.angles_rad)))) > np.pi / 2
    print("| crops | mean mass on the other side | reversed |\n| --- | --- | --- |")
    for low, high in pairwise(REVERSED_MASS):
        part = (mass >= low) & (mass < high)
        if part.any():
            print(f"| {part.sum()} | {mass[part].mean():.3f} | {turned[part].mean():.3f} |")


def draw_reliability(curves: dict[str, np.ndarray], path: Path) -> None:
    """Draw how many points are right against what their scores say."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(4.2, 4.0), layout="constrained")
    axes.plot([0, 1], [0, 1], color="0.7", linewidth=1)
    for name, rows in curves.items():
        axes.plot(rows[:, 1], rows[:, 2], marker="o", markersize=3, linewidth=1, label=name)
    axes.set(xlabel="mean score of a tenth", ylabel="share seen and found", xlim=(0, 1), ylim=(0, 1))
    axes.legend()
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path)
    parser.add_argument("--chunks", type=int, default=5)
    parser.add_argument("--size", type=int, default=CHUNK, help="pictures of a chunk")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--vehicles", nargs="+", choices=VEHICLES, default=["cars", "vans", "unseen"])
    parser.add_argument("--plot", type=Path, help="where to draw the reliability curves")
    a = parser.parse_args()
    curves = {}
    for vehicles in a.vehicles:
        samples, kinds = drawn_samples(vehicles, a.seed, a.chunks, a.size)
        found = answers(None if a.model is None else str(a.model), samples.cuts)
        print(f"\n{vehicles}\n")
        print_groups(found, samples, kinds)
        print()
        print_reliability(found, samples)
        print()
        print_reversed(found, samples)
        curves[vehicles] = reliability(found, samples)
    if a.plot:
        draw_reliability(curves, a.plot)


if __name__ == "__main__":
    main()
