"""Meshes as PLY (Turk 1994), binary little-endian, with what is known of each vertex."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshslam.errors import GeometryError, MapError
from meshslam.geometry import AnyArray, Bools, Floats, Ints, check_gltf, is_gltf

DECIMALS = 9
_KINDS = {"float": "<f4", "float32": "<f4", "double": "<f8", "float64": "<f8", "uchar": "u1", "uint8": "u1"}
_PLAIN = {"x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "alpha", "sigma_m", "observed"}
_TRIANGLES = [
    [["property", "list", "uchar", kind, name]]
    for kind in ("int", "int32", "uint", "uint32")
    for name in ("vertex_indices", "vertex_index")
]
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
    vertices, faces, extra = _plain_ply(path) or _any_mesh(path)
    sigma, observed = _column(extra, "sigma_m"), _column(extra, "observed")
    if not len(vertices) or not len(faces):
        raise MapError(f"{path}: holds no triangles")
    if not np.isfinite(vertices).all() or faces.min() < 0 or faces.max() >= len(vertices):
        raise MapError(f"{path}: holds NaN, or a face whose corner is no vertex")
    if is_gltf(path):
        vertices = vertices @ _Z_UP_FROM_Y_UP.T
    return PlyMesh(vertices, faces, sigma, None if observed is None else observed > 0.5)


def _plain_ply(path: Path) -> tuple[Floats, Ints, AnyArray] | None:
    """Vertices, faces and all that the vertices have, of a binary PLY of plain triangles; None for any other file."""
    try:
        head, end, body = path.read_bytes().partition(b"end_header\n")
    except OSError:
        return None
    lines = [line.split() for line in head.decode("ascii", "replace").splitlines() if not line.startswith("comment")]
    if not end or lines[:2] != [["ply"], ["format", "binary_little_endian", "1.0"]]:
        return None
    starts = [i for i, words in enumerate(lines) if words[:1] == ["element"]]
    if [words[1:2] for words in (lines[i] for i in starts)] != [["vertex"], ["face"]] or starts[0] != 2:
        return None
    (vertex, *columns), (face, *lists) = lines[starts[0] : starts[1]], lines[starts[1] :]
    kinds = [(words[2], _KINDS[words[1]]) for words in columns if len(words) == 3 and words[1] in _KINDS]
    names = [name for name, _ in kinds]
    if len(kinds) != len(columns) or len(set(names)) != len(names) or not {"x", "y", "z"} <= set(names) <= _PLAIN:
        return None
    if lists not in _TRIANGLES or not all(len(w) == 3 and w[2].isascii() and w[2].isdigit() for w in (vertex, face)):
        return None
    layout, corner = np.dtype(kinds), np.dtype([("count", "u1"), ("corners", "<i4", 3)])
    size = int(vertex[2]) * layout.itemsize
    if len(body) != size + int(face[2]) * corner.itemsize:
        return None
    data, triangles = np.frombuffer(body[:size], layout), np.frombuffer(body[size:], corner)
    if (triangles["count"] != 3).any():
        return None
    vertices = np.column_stack([data[axis].astype(np.float64) for axis in "xyz"])
    return vertices, triangles["corners"].astype(np.int64), data


def _any_mesh(path: Path) -> tuple[Floats, Ints, AnyArray]:
    """The same of any file that trimesh reads; MapError if it cannot."""
    import trimesh  # slow to import, as SciPy that it brings

    try:
        mesh = trimesh.load_mesh(path, process=False)
        mesh = mesh.to_mesh() if isinstance(mesh, trimesh.Scene) else mesh
        vertices, faces = np.array(mesh.vertices, np.float64), np.array(mesh.faces, np.int64)
        return vertices, faces, mesh.metadata.get("_ply_raw", {}).get("vertex", {}).get("data", {})
    except Exception as error:  # trimesh raises whatever its parsers do
        raise MapError(f"{path}: cannot be read as a mesh: {' '.join(str(error).split())[:100]}") from None


def _column(data: AnyArray, name: str) -> Floats | None:
    names = getattr(getattr(data, "dtype", None), "names", None) or data
    return np.asarray(data[name], float).reshape(-1) if name in names else None


def _rounded(values: Floats) -> Floats:
    """Round, and turn -0 into 0."""
    return np.round(np.asarray(values, float), DECIMALS) + 0.0
