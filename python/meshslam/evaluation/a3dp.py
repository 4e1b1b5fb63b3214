"""ApolloCar3D's A3DP: average precision where shape, place and rotation must all be near (Song et al. 2019)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from meshslam.evaluation.average_precision import COCO_RECALLS, average_precision, judge
from meshslam.evaluation.seen import SeenFrame
from meshslam.evaluation.trajectories import angles_rad
from meshslam.geometry import Camera, Pose, mask_iou, render
from meshslam.maps import MapObject
from meshslam.sequences import Progress, no_progress

VIEWS = 10  # around the car, from which shapes are compared
_SIDE_CAMERA = Camera(240, 120, 320.0, 320.0, 119.5, 59.5)
_VIEWED_FROM_M = 10.0
_ACROSS = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])  # camera axes of one that looks along x


class Criterion(NamedTuple):
    """What an answer must reach."""

    shape: float  # least mean IoU of the drawn shapes
    translation: float  # most, metres or a share of the distance
    rotation_rad: float  # most


def criteria(*, relative: bool) -> list[Criterion]:
    """The ten criteria of A3DP-Abs (metres) or A3DP-Rel (share of the distance), from loose to strict."""
    moves = np.linspace(0.10, 0.01, 10) if relative else np.linspace(2.8, 0.1, 10)
    rows = zip(np.linspace(0.5, 0.95, 10), moves, np.pi / 60 * np.arange(10, 0, -1), strict=True)
    return [Criterion(float(s) - 1e-9, float(t) + 1e-9, float(r) + 1e-9) for s, t, r in rows]


LOOSE = {False: Criterion(0.5, 2.8, np.pi / 6), True: Criterion(0.5, 0.10, np.pi / 6)}
STRICT = {False: Criterion(0.75, 1.4, np.pi / 12), True: Criterion(0.75, 0.05, np.pi / 12)}


class Likeness(NamedTuple):
    """How near an estimated object is to a true one."""

    shape: float
    translation_m: float
    translation_share: float  # of the true distance from the camera
    rotation_rad: float


def a3dp_figures(frames: Sequence[SeenFrame], progress: Progress = no_progress) -> dict[str, float]:
    """`a3dp_abs_mean`, `_loose`, `_strict` and the same of `a3dp_rel`, from 0 to 1."""
    known = _likenesses(frames, progress)
    figures = {}
    for relative, name in ((False, "abs"), (True, "rel")):
        steps = [_precision(frames, known, c, relative=relative) for c in criteria(relative=relative)]
        figures[f"a3dp_{name}_mean"] = float(np.mean(steps))
        figures[f"a3dp_{name}_loose"] = _precision(frames, known, LOOSE[relative], relative=relative)
        figures[f"a3dp_{name}_strict"] = _precision(frames, known, STRICT[relative], relative=relative)
    return figures


def shape_similarity(one: MapObject, other: MapObject) -> float:
    """Mean IoU of two shapes, each drawn in its own frame from ten directions around it."""
    ious = []
    for k in range(VIEWS):
        turn = Pose.from_yaw(2 * np.pi * k / VIEWS, np.zeros(3)).rotation
        pose = Pose(_ACROSS @ turn, np.array([0.0, 0.0, _VIEWED_FROM_M]))
        masks = [render(_SIDE_CAMERA, [(pose, thing.vertices, thing.faces)]).mask for thing in (one, other)]
        ious.append(mask_iou(masks[0], masks[1]))
    return float(np.mean(ious))


def _likenesses(frames: Sequence[SeenFrame], progress: Progress) -> dict[tuple[int, int, int], Likeness]:
    """By place of the frame, of the estimate and of the truth; shapes are drawn where place and rotation allow it."""
    shapes: dict[tuple[int, int], float] = {}
    far_rad = LOOSE[False].rotation_rad + 1e-6
    known = {}
    for f, seen in enumerate(frames):
        for e, estimate in enumerate(seen.estimates):
            for t, true in enumerate(seen.truths):
                gap = estimate.camera_from_object.translation - true.camera_from_object.translation
                away_m = float(np.linalg.norm(gap))
                share = away_m / float(np.linalg.norm(true.camera_from_object.translation))
                turn = true.camera_from_object.rotation.T @ estimate.camera_from_object.rotation
                rotation_rad = float(angles_rad(turn[None])[0])
                if (away_m > LOOSE[False].translation and share > LOOSE[True].translation) or rotation_rad > far_rad:
                    continue
                key = (estimate.thing.id, true.thing.id)
                if key not in shapes:
                    shapes[key] = shape_similarity(estimate.thing, true.thing)
                known[f, e, t] = Likeness(shapes[key], away_m, share, rotation_rad)
        progress("A3DP", f + 1, len(frames))
    return known


def _precision(
    frames: Sequence[SeenFrame],
    known: dict[tuple[int, int, int], Likeness],
    criterion: Criterion,
    *,
    relative: bool,
) -> float:
    rows = [([e.score for e in f.estimates], [True] * len(f.estimates), [t.counts for t in f.truths]) for f in frames]
    quality: Callable[[int, int, int], float | None] = partial(_quality, known, criterion, relative)
    return average_precision(judge(rows, quality), COCO_RECALLS)


def _quality(
    known: dict[tuple[int, int, int], Likeness], least: Criterion, relative: bool, frame: int, answer: int, truth: int
) -> float | None:
    found = known.get((frame, answer, truth))
    if found is None:
        return None
    move = found.translation_share if relative else found.translation_m
    right = found.shape >= least.shape and move <= least.translation and found.rotation_rad <= least.rotation_rad
    return -found.translation_m if right else None
