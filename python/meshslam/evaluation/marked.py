"""Cars whose places are marked (paper, Sec. V-B: 56 of 62, 1.9 m): objects.json, or KITTI's tracking labels."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshslam.errors import SequenceError
from meshslam.evaluation.objects import counted_objects
from meshslam.evaluation.truth import read_truth
from meshslam.geometry import Floats, Pose, best_pairs
from meshslam.maps import Map

MATCH_DISTANCE_M = 5.0
_LABELLED = ("Car", "Van")
_NEAR_M, _LEAST_FRAMES = 40.0, 8  # a labelled car that is as near in as many frames counts
_STANDS_M = 1.0  # by which the labels of a parked car lie apart at most
_COLUMNS = 17


@dataclass(frozen=True, eq=False)
class MarkedScore:
    """How many marked cars have an estimate, and how far from their places."""

    positions: Floats  # (n, 3), marked, in world
    errors_m: Floats  # of those that have an estimate

    def figures(self) -> dict[str, float]:
        """`marked`, `reconstructed`, and `position_error_mean_m` where any is."""
        rows: dict[str, float] = {"marked": len(self.positions), "reconstructed": len(self.errors_m)}
        return rows | ({"position_error_mean_m": float(self.errors_m.mean())} if len(self.errors_m) else {})


def score_marked(positions: Floats, estimate: Map) -> MarkedScore:
    """Match marked places (n, 3) one to one with objects, on the ground, within MATCH_DISTANCE_M."""
    centres = np.array([thing.world_from_object.translation for thing in estimate.objects]).reshape(-1, 3)
    distance = np.linalg.norm(positions[:, None, :2] - centres[None, :, :2], axis=2)
    far = 1e3
    pairs = best_pairs(-np.where(distance > MATCH_DISTANCE_M, far, distance))
    found = np.array([distance[pair] for pair in pairs])
    return MarkedScore(positions, found[found <= MATCH_DISTANCE_M])


def marked_objects(sequence_folder: Path) -> Floats | None:
    """Places (n, 3) of a sequence's objects.json, those that are seen often enough; None where there is none."""
    truth = read_truth(sequence_folder)
    if truth.objects is None:
        return None
    counted = counted_objects(truth)
    return np.array(
        [thing.world_from_object.translation for thing in truth.objects.objects if thing.id in counted]
    ).reshape(-1, 3)


def marked_labels(path: Path, pose_of_frame: dict[int, Pose]) -> Floats:
    """Places (n, 3) of the parked cars in a KITTI tracking label file; SequenceError naming the line that is wrong."""
    tracks: dict[int, list[tuple[float, Floats]]] = {}
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise SequenceError(f"{path}: cannot be read: {error}") from None
    for number, line in enumerate(lines, 1):
        words = line.split()
        if not words:
            continue
        try:
            if len(words) < _COLUMNS:
                raise ValueError
            frame, track, (height, _, _, x, y, z) = int(words[0]), int(words[1]), map(float, words[10:16])
        except ValueError:
            raise SequenceError(f"{path}: line {number}: expected KITTI's {_COLUMNS} columns, found {line!r}") from None
        if words[2] in _LABELLED and frame in pose_of_frame:
            middle = np.array([x, y - height / 2, z])
            tracks.setdefault(track, []).append((float(np.hypot(x, z)), pose_of_frame[frame].transform(middle)))
    places = [found for rows in tracks.values() if (found := _parked_place(rows)) is not None]
    return np.array(places).reshape(-1, 3)


def _parked_place(rows: list[tuple[float, Floats]]) -> Floats | None:
    """Where a labelled car stands, by its nearest label; None if it moves or is never near for long."""
    near = [row for row in rows if row[0] < _NEAR_M]
    if len(near) < _LEAST_FRAMES:
        return None
    places = np.array([place for _, place in near])
    if np.linalg.norm(places - np.median(places, axis=0), axis=1).max() > _STANDS_M:
        return None
    nearest: Floats = places[int(np.argmin([away for away, _ in near]))]
    return nearest
