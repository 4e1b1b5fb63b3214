"""Tracks: MOTA (Bernardin and Stiefelhagen 2008), IDF1 (Ristani et al. 2016), HOTA (Luiten et al. 2021)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats, Ints, best_pairs
from meshslam.perception import Detection, DetectionSet

LEAST_IOU = 0.5  # of two boxes in MOTA and IDF1
ALPHAS = np.arange(1, 20) / 20  # thresholds of HOTA
_SAME = 1e-9


@dataclass(frozen=True, eq=False)
class TrackFrame:
    """True and estimated tracks in one frame, as places 0, 1, … in the drive's lists, and how alike their boxes are."""

    truths: Ints  # (n,)
    estimates: Ints  # (m,)
    similarity: Floats  # (n, m), IoU of the boxes


@dataclass(frozen=True, eq=False)
class TrackDrive:
    """The tracks of a drive."""

    frames: tuple[TrackFrame, ...]
    true_count: int  # of tracks
    estimated_count: int

    @property
    def true_boxes(self) -> int:
        """Boxes of true tracks."""
        return sum(len(f.truths) for f in self.frames)

    @property
    def estimated_boxes(self) -> int:
        """Boxes of estimated tracks."""
        return sum(len(f.estimates) for f in self.frames)


def track_drive(
    true_detections: DetectionSet, object_of_annotation: Mapping[int, int], detections: DetectionSet
) -> TrackDrive:
    """Tracks of a run over its frames: true ones are detections with an object, estimated ones those with a track."""
    given = true_detections.by_frame()
    rows = []
    for frame, found in detections.by_frame().items():
        truths = [(object_of_annotation[d.id], d) for d in given.get(frame, ()) if d.id in object_of_annotation]
        rows.append((truths, [(d.track_id, d) for d in found if d.track_id is not None]))
    places = [
        {number: k for k, number in enumerate(sorted({n for row in rows for n, _ in row[side]}))} for side in (0, 1)
    ]
    frames = tuple(
        TrackFrame(
            np.array([places[0][n] for n, _ in truths], np.int64),
            np.array([places[1][n] for n, _ in estimates], np.int64),
            _overlaps([d for _, d in truths], [d for _, d in estimates]),
        )
        for truths, estimates in rows
    )
    return TrackDrive(frames, len(places[0]), len(places[1]))


def mota_figures(drive: TrackDrive) -> dict[str, float]:
    """`mota`, and what it counts: false negatives, false positives, switches of identity.

    A match of the frame before is kept while it still overlaps enough.
    """
    matched = switches = 0
    last_of: dict[int, int] = {}  # the estimate that a true track had last
    before: dict[int, int] = {}  # in the frame before
    for f in drive.frames:
        kept = np.array([[before.get(t) == e for e in f.estimates.tolist()] for t in f.truths.tolist()], float)
        score = np.where(f.similarity >= LEAST_IOU - _SAME, f.similarity + 1e3 * kept.reshape(f.similarity.shape), 0.0)
        now = {int(f.truths[i]): int(f.estimates[j]) for i, j in best_pairs(score) if score[i, j] > 0}
        switches += sum(last_of.get(t, e) != e for t, e in now.items())
        matched += len(now)
        last_of |= now
        before = now
    missed, wrong = drive.true_boxes - matched, drive.estimated_boxes - matched
    rows: dict[str, float] = {"mota_misses": missed, "mota_false_positives": wrong, "mota_id_switches": switches}
    share = {"mota": 1 - (missed + wrong + switches) / drive.true_boxes} if drive.true_boxes else {}
    return share | rows


def idf1_figures(drive: TrackDrive) -> dict[str, float]:
    """`idf1`: the F1 score of the best one-to-one assignment of whole tracks."""
    alike = np.zeros((drive.true_count, drive.estimated_count))
    for f in drive.frames:
        i, j = np.nonzero(f.similarity >= LEAST_IOU - _SAME)
        np.add.at(alike, (f.truths[i], f.estimates[j]), 1)
    shared = sum(alike[pair] for pair in best_pairs(alike))
    total = drive.true_boxes + drive.estimated_boxes
    return {"idf1": float(2 * shared / total)} if total else {}


def hota_figures(drive: TrackDrive) -> dict[str, float]:
    """`hota`, `hota_deta`, `hota_assa`: means over overlaps of 0.05 to 0.95."""
    if not drive.true_boxes or not drive.estimated_boxes:
        return {"hota": 0.0, "hota_deta": 0.0, "hota_assa": 0.0} if drive.true_boxes or drive.estimated_boxes else {}
    of_truth = np.bincount(np.concatenate([f.truths for f in drive.frames]), minlength=drive.true_count)[:, None]
    of_estimate = np.bincount(np.concatenate([f.estimates for f in drive.frames]), minlength=drive.estimated_count)
    potential = np.zeros((drive.true_count, drive.estimated_count))
    for f in drive.frames:
        total = f.similarity.sum(axis=0, keepdims=True) + f.similarity.sum(axis=1, keepdims=True) - f.similarity
        share = np.divide(f.similarity, total, out=np.zeros_like(total), where=total > _SAME)
        np.add.at(potential, (f.truths[:, None], f.estimates[None]), share)
    alignment = potential / (of_truth + of_estimate - potential)
    rows = np.array([_at_alpha(drive, float(a), alignment, of_truth, of_estimate) for a in ALPHAS])
    hota, deta, assa = rows.mean(axis=0).tolist()
    return {"hota": hota, "hota_deta": deta, "hota_assa": assa}


def _at_alpha(
    drive: TrackDrive, alpha: float, alignment: Floats, of_truth: Ints, of_estimate: Ints
) -> tuple[float, float, float]:
    """HOTA, detection accuracy and association accuracy at one overlap."""
    together = np.zeros_like(alignment)
    for f in drive.frames:
        score = alignment[np.ix_(f.truths, f.estimates)] * f.similarity
        for i, j in best_pairs(score):
            if f.similarity[i, j] >= alpha - _SAME:
                together[f.truths[i], f.estimates[j]] += 1
    right = together.sum()
    deta = right / (drive.true_boxes + drive.estimated_boxes - right)
    assa = (together * together / np.maximum(of_truth + of_estimate - together, 1)).sum() / max(right, 1)
    return float(np.sqrt(deta * assa)), float(deta), float(assa)


def _overlaps(truths: Sequence[Detection], estimates: Sequence[Detection]) -> Floats:
    """IoU (n, m) of two lists of boxes."""
    a, b = (np.array([d.bbox for d in found], float).reshape(-1, 4) for found in (truths, estimates))
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, :2] + a[:, None, 2:], b[None, :, :2] + b[None, :, 2:])
    both = np.prod(np.maximum(high - low, 0), axis=2)
    either = np.prod(a[:, 2:], axis=1)[:, None] + np.prod(b[:, 2:], axis=1)[None] - both
    found: Floats = np.divide(both, either, out=np.zeros_like(both), where=either > 0)
    return found
