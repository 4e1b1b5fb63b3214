"""All meshes in the world as one Wavefront OBJ, an object each, vertex colours behind the coordinates."""

from __future__ import annotations

from pathlib import Path

from meshslam.exporting.finished_run import FinishedRun
from meshslam.exporting.formats import Notes
from meshslam.maps import vertex_colours


def write(run: FinishedRun, target: Path) -> Notes:
    """Z up, metres; corners are counted from 1 through the whole file."""
    lines, start = ["# metres, z up"], 1
    for thing in run.scene.objects:
        lines.append(f"o {thing.category}_{thing.id}")
        colours = vertex_colours(thing)[:, :3] / 255.0
        for point, colour in zip(thing.vertices_in_world, colours, strict=True):
            lines.append("v " + " ".join(f"{value + 0.0:.6f}" for value in (*point, *colour)))
        lines += [f"f {a} {b} {c}" for a, b, c in (thing.faces + start).tolist()]
        start += len(thing.vertices)
    target.write_text("\n".join(lines) + "\n", encoding="ascii")
    return () if run.scene.objects else ("obj: the map has no objects: the file has no triangles",)
