"""All meshes in the world as one PLY: the meshes of a run's folder are each about their own origin."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from meshslam.exporting.finished_run import FinishedRun
from meshslam.exporting.formats import Notes
from meshslam.maps import vertex_colours


def write(run: FinishedRun, target: Path) -> Notes:
    """Vertices have x y z (float64, metres), colour, `object` (its number), `sigma_m` (NaN where not known)."""
    things = run.scene.objects
    counts = np.cumsum([0, *(len(thing.vertices) for thing in things)])
    names = [("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("red", "u1"), ("green", "u1"), ("blue", "u1")]
    vertices = np.zeros(int(counts[-1]), [*names, ("object", "<i4"), ("sigma_m", "<f4")])
    faces = np.zeros(sum(len(thing.faces) for thing in things), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"] = 3
    if things:
        faces["corners"] = np.concatenate([thing.faces + at for thing, at in zip(things, counts, strict=False)])
    for thing, start, end in zip(things, counts, counts[1:], strict=False):
        rows = vertices[start:end]
        rows["x"], rows["y"], rows["z"] = thing.vertices_in_world.T
        rows["red"], rows["green"], rows["blue"] = vertex_colours(thing)[:, :3].T
        rows["object"] = thing.id
        rows["sigma_m"] = np.nan if thing.vertex_sigma_m is None else thing.vertex_sigma_m
    kinds = {"<f8": "double", "u1": "uchar", "<i4": "int", "<f4": "float"}
    layout = [*names, ("object", "<i4"), ("sigma_m", "<f4")]
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(vertices)}",
        *(f"property {kinds[kind]} {name}" for name, kind in layout),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    target.write_bytes("\n".join(header).encode() + vertices.tobytes() + faces.tobytes())
    return () if things else ("ply: the map has no objects: the file has no triangles",)
