"""Average precision of scored answers that are right or wrong."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats

KITTI_RECALLS = np.arange(1, 41) / 40  # Simonelli et al. 2019; KITTI since then
COCO_RECALLS = np.arange(101) / 100


@dataclass(frozen=True, eq=False)
class Judged:
    """Answers to count, and how many true things there are to find."""

    scores: Floats  # (n,)
    right: Floats  # (n,), 1 or 0
    true_count: int


def judge(
    frames: Sequence[tuple[Sequence[float], Sequence[bool], Sequence[bool]]],
    quality: Callable[[int, int, int], float | None],
) -> Judged:
    """Match answers to true things, frame by frame, the surest answer first.

    A frame has the answers' scores, whether each answer counts where it finds nothing, and whether each true thing
    counts. `quality(frame, answer, truth)` is None where the two cannot match, else larger for a better match. An
    answer takes the best true thing that is left, one that counts before one that does not; what it finds of those
    that do not count is neither right nor wrong.
    """
    scores, right, count = [], [], 0
    for frame, (given, answer_counts, truth_counts) in enumerate(frames):
        left = set(range(len(truth_counts)))
        count += sum(truth_counts)
        for answer in sorted(range(len(given)), key=lambda k: (-given[k], k)):
            found = {t: q for t in left if (q := quality(frame, answer, t)) is not None}
            if not found:
                if answer_counts[answer]:
                    scores.append(given[answer])
                    right.append(0.0)
                continue
            best = max(found, key=lambda t: (truth_counts[t], found[t], -t))
            left.discard(best)
            if truth_counts[best]:
                scores.append(given[answer])
                right.append(1.0)
    return Judged(np.array(scores), np.array(right), count)


def average_precision(judged: Judged, recalls: Floats) -> float:
    """Mean over `recalls` of the best precision at that recall or a higher one, from 0 to 1.

    Answers of one score are taken together: their order says nothing.
    """
    if not judged.true_count or not len(judged.scores):
        return 0.0
    order = np.argsort(-judged.scores, kind="stable")
    scores, right = judged.scores[order], np.cumsum(judged.right[order])
    last = np.append(np.diff(scores) != 0, True)
    precision, recall = (right / np.arange(1, len(right) + 1))[last], right[last] / judged.true_count
    best = np.maximum.accumulate(precision[::-1])[::-1]
    at = np.searchsorted(recall, recalls - 1e-12)
    return float(np.append(best, 0.0)[at].mean())
