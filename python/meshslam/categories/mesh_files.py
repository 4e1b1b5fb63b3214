"""Mesh files and their key points, read, checked and brought into the object frame."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from meshslam.categories.mesh_parts import object_count, without_shadow_planes
from meshslam.categories.mesh_solid import surface_points
from meshslam.errors import CategoryError, GeometryError
from meshslam.geometry import Floats, Ints, check_gltf, is_gltf

Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
AxisOrAuto = Literal["auto", "x", "y", "z", "-x", "-y", "-z"]
Symmetry = Literal["auto", "x", "y"]
SMALLEST_M, LARGEST_M = 0.05, 60.0  # longest side: beyond it the unit is wrong
SYMMETRY_SAMPLES = 3000
PREFERRED = 1.3  # a plane found must be this much better than y = 0 to turn the mesh
ASYMMETRIC = 0.02  # of the longest side


@dataclass(frozen=True, eq=False)
class NamedMesh:
    """A mesh in metres with the key points that are known of it."""

    name: str
    vertices: Floats  # (V, 3)
    faces: Ints  # (F, 3)
    keypoints: dict[str, Floats]

    def moved(self, rotation: Floats, shift: Floats) -> NamedMesh:
        """The mesh and its key points at rotation @ p + shift."""
        points = {key: rotation @ p + shift for key, p in self.keypoints.items()}
        return replace(self, vertices=self.vertices @ rotation.T + shift, keypoints=points)


def read_mesh(path: Path, scale: float = 1.0) -> NamedMesh:
    """Read any triangle mesh that trimesh knows, with equal vertices joined; CategoryError says what is wrong."""
    if not path.is_file():
        raise CategoryError(f"no mesh file at {path}")
    try:
        check_gltf(path)
    except GeometryError as error:
        raise CategoryError(str(error)) from None
    try:
        mesh = trimesh.load_mesh(path, process=False)
    except Exception as error:  # each of trimesh's readers fails in its own way
        raise CategoryError(f"{path}: not a mesh that can be read ({type(error).__name__}: {error})") from error
    mesh = mesh.to_mesh() if isinstance(mesh, trimesh.Scene) else mesh
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise CategoryError(f"{path}: holds no faces: a category needs triangle meshes")
    used = np.asarray(mesh.vertices, np.float64)[np.unique(mesh.faces)]
    if not np.isfinite(used).all():
        raise CategoryError(f"{path}: vertices hold NaN or infinity")
    mesh.remove_unreferenced_vertices()
    vertices = scale * np.asarray(mesh.vertices, np.float64)
    longest = float(np.ptp(vertices, axis=0).max())
    if not SMALLEST_M <= longest <= LARGEST_M:
        wanted = f"{SMALLEST_M:g} to {LARGEST_M:g} m expected: --scale takes the file's unit to metres{_unit(longest)}"
        raise CategoryError(f"{path}: its longest side is {longest:.4g} m, {wanted}")
    return NamedMesh(path.stem, vertices, np.asarray(mesh.faces, np.int64), {})


def _unit(longest: float) -> str:
    """What unit a vehicle of that size is likely in."""
    for name, scale in (("centimetres", 0.01), ("millimetres", 0.001)):
        if 1.0 <= longest * scale <= 20.0:
            return f" (for {name} it is {scale:g})"
    return ""


def cleaned(mesh: NamedMesh, up: Axis) -> tuple[NamedMesh, list[str]]:
    """The mesh without shadow planes, and notes on these and on several objects in one file."""
    faces, sheets = without_shadow_planes(mesh.vertices, mesh.faces, _direction(up))
    said = [f"{mesh.name}: {sheets} level sheet under it (a shadow plane) is left out"] if sheets else []
    if sheets:
        used, numbered = np.unique(faces, return_inverse=True)
        mesh = replace(mesh, vertices=mesh.vertices[used], faces=numbered.reshape(-1, 3))
    count = object_count(mesh.vertices, mesh.faces)
    if count > 1:
        said.append(f"{mesh.name}: {count} objects stand apart in this file: a category needs one object a file")
    return mesh, said


def axes_of(mesh: NamedMesh, path: Path, forward: AxisOrAuto, up: AxisOrAuto) -> tuple[Axis, Axis, str | None]:
    """Forward and up of a file: as given, else by its format, with a note: glTF is y up; all others are x, z."""
    chosen_up: Axis = up if up != "auto" else "y" if is_gltf(path) else "z"
    if forward != "auto":
        chosen: Axis = forward
    elif chosen_up[-1] == "y":
        length_x, _, length_z = np.ptp(mesh.vertices, axis=0)
        chosen = "x" if length_x > length_z else "z"
    else:
        chosen = "x" if chosen_up[-1] != "x" else "y"
    if not is_gltf(path) or "auto" not in (forward, up):
        return chosen, chosen_up, None
    return chosen, chosen_up, f"{mesh.name}: a glTF file: {chosen_up} is up, {chosen} ahead (--up, --forward)"


def read_keypoints(path: Path, meshes: list[NamedMesh], scale: float = 1.0) -> list[NamedMesh]:
    """The meshes with their key points from `{mesh file's stem: {name: [x, y, z]}}`, in the mesh file's frame.

    A mesh may have none, but those that have any have the same names; CategoryError names what does not fit.
    """
    try:
        document = json.loads(path.read_text())
    except FileNotFoundError:
        raise CategoryError(f"no key point file at {path}") from None
    except (ValueError, OSError, RecursionError) as error:
        raise CategoryError(f"{path}: not readable as JSON ({error})") from error
    if not isinstance(document, dict) or not all(isinstance(points, dict) for points in document.values()):
        raise CategoryError(f'{path}: {{"mesh file\'s stem": {{"key point": [x, y, z]}}}} expected')
    found = [replace(mesh, keypoints=_points(path, mesh, document, scale)) for mesh in meshes]
    with_points = [mesh for mesh in found if mesh.keypoints]
    if not with_points:
        raise CategoryError(f"{path}: names none of the meshes {', '.join(mesh.name for mesh in meshes[:5])}")
    first = with_points[0]
    for mesh in with_points:
        for name in [*first.keypoints, *mesh.keypoints]:
            if (name in first.keypoints) != (name in mesh.keypoints):
                lacks, has = (mesh, first) if name in first.keypoints else (first, mesh)
                raise CategoryError(f"{path}: {lacks.name} lacks key point {name!r}, which {has.name} has")
    return found


def _points(path: Path, mesh: NamedMesh, document: dict[str, dict[str, object]], scale: float) -> dict[str, Floats]:
    points, low, high = {}, mesh.vertices.min(0), mesh.vertices.max(0)
    slack = 0.25 * float((high - low).max())
    for name, value in document.get(mesh.name, {}).items():
        try:
            point = scale * np.asarray(value, np.float64)
        except (TypeError, ValueError):
            point = np.full(3, np.nan)
        if point.shape != (3,) or not np.isfinite(point).all():
            raise CategoryError(f"{path}: {mesh.name}: {name}: three finite numbers expected, found {value!r:.60}")
        if (point < low - slack).any() or (point > high + slack).any():
            raise CategoryError(f"{path}: {mesh.name}: {name}: {point.tolist()} lies far off the mesh: another frame?")
        points[name] = point
    return points


def turned(mesh: NamedMesh, forward: Axis, up: Axis) -> NamedMesh:
    """The mesh with its `forward` and `up` axes laid on x and z; CategoryError if they are one axis."""
    if forward[-1] == up[-1]:
        raise CategoryError(f"forward {forward} and up {up} are one axis: two different ones are needed")
    x, z = _direction(forward), _direction(up)
    return mesh.moved(np.array([x, np.cross(z, x), z]), np.zeros(3))


def _direction(axis: Axis) -> Floats:
    unit: Floats = np.eye(3)["xyz".index(axis[-1])] * (-1 if axis[0] == "-" else 1)
    return unit


def centred(mesh: NamedMesh) -> NamedMesh:
    """The mesh about the centre of its bounding box."""
    return mesh.moved(np.eye(3), -(mesh.vertices.min(0) + mesh.vertices.max(0)) / 2)


def upright(mesh: NamedMesh, symmetry: Symmetry) -> tuple[NamedMesh, str | None]:
    """The mesh, centred, with its vertical plane of symmetry as y = 0; and a note where something was done about it.

    `symmetry` names the plane's normal, or `auto`: of all vertical planes the one in which the mesh is most like its
    mirror image, and y = 0 where no other is much better. The mesh is turned by at most 90 degrees.
    """
    mesh = centred(mesh)
    if symmetry == "x":
        return centred(mesh.moved(_about_z(np.pi / 2), np.zeros(3))), None
    if symmetry == "y":
        return mesh, None
    points = _samples(mesh)
    angle = _best_plane(points)
    longest = float(np.ptp(mesh.vertices, axis=0).max())
    straight, best = asymmetry(points, 0.0), asymmetry(points, angle)
    note = None
    if straight > PREFERRED * best + 1e-3 * longest:
        mesh, straight = centred(mesh.moved(_about_z(-angle), np.zeros(3))), best
        note = f"{mesh.name}: turned by {np.degrees(-angle):.1f} degrees, to its plane of symmetry"
    if straight > ASYMMETRIC * longest:
        away = f"{straight:.2g} m from its mirror image"
        note = f"{mesh.name}: no plane of symmetry ({away}): it is made symmetric in y = 0"
    return mesh, note


def asymmetry(points: Floats, angle: float) -> float:
    """RMS distance (m) of points (n, 3) to their mirror image in the vertical plane at `angle` from x."""
    normal = np.array([-np.sin(angle), np.cos(angle), 0.0])
    along = points @ normal
    mirrored = points - (2 * along - along.min() - along.max())[:, None] * normal
    return float(np.sqrt((np.asarray(cKDTree(points).query(mirrored)[0]) ** 2).mean()))


def _best_plane(points: Floats) -> float:
    """Angle of the plane of the least asymmetry, from -90 to 90 degrees, to a tenth of a degree."""
    angles, step = np.radians(np.arange(-88, 90, 4.0)), np.radians(4.0)
    best = 0.0
    while step > np.radians(0.1):
        best = float(min(angles, key=lambda a: asymmetry(points, float(a))))
        step /= 3
        angles = best + step * np.arange(-3, 4)
    return best


def _samples(mesh: NamedMesh) -> Floats:
    points = surface_points(mesh.vertices, mesh.faces, float(np.ptp(mesh.vertices, axis=0).max()) / 80)
    chosen: Floats = np.random.default_rng(0).permutation(points)[:SYMMETRY_SAMPLES]
    return chosen


def _about_z(angle: float) -> Floats:
    return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
