"""The paper's two figures of a path: from above among the cars, and its error over the iterations (its Fig. 4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from meshslam.geometry import Pose
from meshslam.maps import Map
from meshslam.viewing.charts import Line
from meshslam.viewing.from_above import footprint
from meshslam.viewing.line_picture import line_picture

ESTIMATE = "estimate"
ITERATION = "ate_iteration_"  # of the figures' keys that hold an iteration's error


def path_chart(scene: Map, paths: Mapping[str, Sequence[Pose]]) -> bytes:
    """PNG of named paths and of the objects' footprints from above."""
    return line_picture("from above", lines_from_above(scene, paths), "x, m", "y, m", equal=True)


def lines_from_above(scene: Map, paths: Mapping[str, Sequence[Pose]]) -> list[Line]:
    """Named paths, the estimate as a band below the others, then the outline of each object."""
    lines = []
    for name, path in sorted(paths.items(), key=lambda item: item[0] != ESTIMATE):
        places = np.array([pose.translation for pose in path])
        lines.append(Line(name, places[:, 0].tolist(), places[:, 1].tolist(), wide=name == ESTIMATE))
    for thing in scene.objects:
        hull = footprint(thing)
        closed = np.concatenate([hull, hull[:1]])
        lines.append(Line("", closed[:, 0].tolist(), closed[:, 1].tolist()))
    return lines


def iterations_chart(figures: Mapping[str, float]) -> bytes | None:
    """PNG of the path's error after each iteration; None where the figures hold none."""
    errors = [figures[key] for key in sorted(figures) if key.startswith(ITERATION)]
    if not errors:
        return None
    line = Line("absolute trajectory error", list(range(len(errors))), errors)
    return line_picture("error over the iterations", [line], "iterations", "m")
