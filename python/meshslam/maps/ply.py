"""Meshes as PLY (Turk 1994), binary little-endian, with what is known of each vertex."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshslam.errors import GeometryError, MapError
from meshslam.geometry import AnyArray, Bools, Floats, Ints, check_gltf, is_gltf

DECIMALS = 9
_Z_UP_FROM_Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


@dataclass(frozen=True, eq=False)
class PlyMesh:
    """A triangle mesh."""

    vertices: Floats  # (V, 3), metres
    faces: Ints  # (F, 3)
    sigma_m: Floats | None = None  # (V,), standard deviation of each vertex along its normal
    observed: Bools | None = None  # (V,), whether any view shows it


def format_ply(mesh: PlyMesh) -> bytes:
    """Write floats, which all readers take, rounded to a nanometre: reading and writing again gives the same bytes."""
    columns: dict[str, AnyArray] = dict(zip("xyz", _rounded(mesh.vertices).T, strict=True))
    if mesh.sigma_m is not None:
        columns["sigma_m"] = _rounded(mesh.sigma_m)
    if mesh.observed is not None:
        columns["observed"] = mesh.observed.astype(np.uint8)
    layout = [(name, "u1" if name == "observed" else "<f4") for name in columns]
    vertices = np.empty(len(mesh.vertices), layout)
    for name, values in columns.items():
        vertices[name] = values
    faces = np.empty(len(mesh.faces), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    properties = [f"property {'uchar' if kind == 'u1' else 'float'} {name}" for name, kind in layout]
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(vertices)}",
        *properties,
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    return "\n".join(header).encode() + vertices.tobytes() + faces.tobytes()


def read_mesh(path: Path) -> PlyMesh:
    """Read a PLY, or any mesh file that trimesh knows; MapError if it is missing, damaged, empty or holds NaN.

    glTF is y up: it is turned so that z is.
    """
    if not path.is_file():
        raise MapError(f"{path}: no such mesh")
    try:
        check_gltf(path)
    except GeometryError as error:
        raise MapError(str(error)) from None
    import trimesh  # slow to import

    try:
        mesh = trimesh.load_mesh(path, process=False)
        mesh = mesh.to_mesh() if isinstance(mesh, trimesh.Scene) else mesh
        vertices, faces = np.array(mesh.vertices, np.float64), np.array(mesh.faces, np.int64)
        extra = mesh.metadata.get("_ply_raw", {}).get("vertex", {}).get("data", {})
        sigma, observed = _column(extra, "sigma_m"), _column(extra, "observed")
    except Exception as error:  # trimesh raises whatever its parsers do
        raise MapError(f"{path}: cannot be read as a mesh: {' '.join(str(error).split())[:100]}") from None
    if not len(vertices) or not len(faces):
        raise MapError(f"{path}: holds no triangles")
    if not np.isfinite(vertices).all() or faces.min() < 0 or faces.max() >= len(vertices):
        raise MapError(f"{path}: holds NaN, or a face whose corner is no vertex")
    if is_gltf(path):
        vertices = vertices @ _Z_UP_FROM_Y_UP.T
    return PlyMesh(vertices, faces, sigma, None if observed is None else observed > 0.5)


def _column(data: AnyArray, name: str) -> Floats | None:
    names = getattr(getattr(data, "dtype", None), "names", None) or data
    return np.asarray(data[name], float).reshape(-1) if name in names else None


def _rounded(values: Floats) -> Floats:
    """Round, and turn -0 into 0."""
    return np.round(np.asarray(values, float), DECIMALS) + 0.0
