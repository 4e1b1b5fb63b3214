"""KITTI odometry's t_rel and r_rel over 100 to 800 m (Geiger et al. 2012; its devkit's evaluate_odometry)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.evaluation.path_pairs import PathPair, distances_along_m, positions
from meshslam.evaluation.trajectories import relative_errors
from meshslam.geometry import Floats

LENGTHS_M = (100, 200, 300, 400, 500, 600, 700, 800)
STEP_FRAMES = 10  # from one first frame to the next


@dataclass(frozen=True, eq=False)
class Segments:
    """Errors of all segments of a path, each over its length."""

    lengths_m: Floats  # (n,), one of LENGTHS_M
    translation_per_m: Floats  # (n,)
    rotation_rad_per_m: Floats  # (n,)

    def __len__(self) -> int:
        return len(self.lengths_m)


def segment_errors(pair: PathPair) -> Segments:
    """From every tenth pose, the errors over each length that the true path still has.

    A segment ends at the first pose that is further along the true path than its length. The error is that of the
    relative pose, over the nominal length.
    """
    along = distances_along_m(positions(pair.truth))
    rows = []
    for first in range(0, len(pair), STEP_FRAMES):
        for length in LENGTHS_M:
            last = int(np.searchsorted(along, along[first] + length, side="right"))
            if last < len(along):
                rows.append((first, last, length))
    table = np.array(rows, np.int64).reshape(-1, 3)
    lengths_m = table[:, 2].astype(float)
    translation_m, rotation_rad = relative_errors(pair, table[:, 0], table[:, 1])
    return Segments(lengths_m, translation_m / lengths_m, rotation_rad / lengths_m)


def kitti_odometry_figures(pair: PathPair) -> dict[str, float]:
    """Means over all segments: `kitti_t_rel_percent`, `kitti_r_rel_deg_per_100m`; empty for paths below 100 m.

    The devkit prints r_rel in degrees a metre; tables of papers have it a hundred metres.
    """
    found = segment_errors(pair)
    if not len(found):
        return {}
    return {
        "kitti_t_rel_percent": float(100 * found.translation_per_m.mean()),
        "kitti_r_rel_deg_per_100m": float(100 * np.degrees(found.rotation_rad_per_m.mean())),
        "kitti_segments": len(found),
    }
