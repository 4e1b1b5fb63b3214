"""A category from mesh files: read, turn upright, wrap one template around all, take mean and modes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshslam.categories.build import wheel_vertices
from meshslam.categories.category import Category
from meshslam.categories.keypoints import mirrored_weights, point_weights
from meshslam.categories.mesh_files import Axis, NamedMesh, Symmetry, read_keypoints, read_mesh, turned, upright
from meshslam.categories.mesh_solid import MeshSolid
from meshslam.categories.modes import principal_modes
from meshslam.categories.procedural.solid import project
from meshslam.categories.shrinkwrap import FLIP, Wrapper, carry
from meshslam.categories.spheres import icosphere
from meshslam.errors import CategoryError
from meshslam.geometry import Floats, voxel_iou
from meshslam.settings import Settings, setting

MANY = 5  # meshes whose differences tell enough about sizes
SIZE_SIGMA = 0.05
BALLS = (0.2, 0.1, 0.05)  # of the longest side: closings that the template shrinks through
TURNED_BETTER = 0.02  # overlap by which a mesh must gain to be turned round

Note = Callable[[str], None]


@dataclass(frozen=True)
class MeshOptions(Settings):
    """How mesh files are read and what is made of them."""

    forward: Axis = setting("x")
    up: Axis = setting("z")
    scale: float = setting(1.0, above=0)  # the file's unit in metres
    symmetry: Symmetry = setting("auto")
    modes: int = setting(20, low=0)
    # relative, of length, width and height; None: 0.05 below five meshes, else 0
    size_sigma: float | None = setting(None, low=0, below=0.5)


def category_from_meshes(
    name: str, paths: list[Path], keypoints: Path | None = None, options: MeshOptions | None = None
) -> tuple[Category, tuple[str, ...]]:
    """Build a category from mesh files; one is enough, and key points need not be known.

    Also returns notes: a line for each thing that the user should know of how it was made. The same files give the same
    category. CategoryError names the file and what is wrong with it.
    """
    options, notes = options or MeshOptions(), list[str]()
    _check(name, paths, options)
    meshes = [read_mesh(path, options.scale) for path in paths]
    if keypoints is not None:
        meshes = read_keypoints(keypoints, meshes, options.scale)
    upright_meshes = []
    for mesh in meshes:
        straight, said = upright(turned(mesh, options.forward, options.up), options.symmetry)
        upright_meshes.append(straight)
        if said:
            notes.append(said)
    wrapper = Wrapper(icosphere(3))
    shapes, meshes = wrapped(wrapper, upright_meshes, notes.append)
    sphere = wrapper.sphere
    if len(shapes) > 1:
        mean, modes = principal_modes(shapes, sphere.faces, min(options.modes, len(shapes) - 1))
    else:
        mean, modes = shapes[0], np.zeros((0, *shapes[0].shape))
    mean = wrapper.symmetrized(mean - (mean.max(0) + mean.min(0)) / 2)
    modes = np.array([wrapper.symmetrized(mode) for mode in modes]).reshape(-1, *mean.shape)
    names, weights = _keypoint_weights(wrapper, shapes, meshes)
    category = Category(
        name=name,
        vertices=mean,
        faces=sphere.faces,
        modes=np.concatenate([modes, size_modes(mean, _size_sigma(options, len(paths)))]),
        mirror=sphere.mirror,
        keypoint_names=names,
        keypoint_weights=weights,
        wheel_vertices=wheel_vertices(mean, sphere.mirror),
    )
    return category, tuple(notes)


def wrapped(wrapper: Wrapper, meshes: list[NamedMesh], note: Note) -> tuple[Floats, list[NamedMesh]]:
    """Vertices (N, V, 3) of the template on each mesh, about the centre of its box, and the meshes in that frame."""
    sizes = np.log([np.ptp(mesh.vertices, axis=0) + 1e-6 for mesh in meshes])
    middle = int(np.abs(sizes - np.median(sizes, axis=0)).sum(1).argmin())
    solids = [_solid(mesh) for mesh in meshes]
    template = lay_template(wrapper, solids[middle])
    shapes, placed = [], []
    for mesh, solid in zip(meshes, solids, strict=True):
        if mesh is not meshes[middle] and _turned_round(meshes[middle], solids[middle], mesh, solid):
            note(f"{mesh.name}: turned round: its front lies at the others' rear")
            mesh = mesh.moved(np.diag([-1.0, -1, 1]), np.zeros(3))
            solid = _solid(mesh)
        start = carry(template, *_landmarks(meshes[middle], mesh))
        shape = template if mesh is meshes[middle] else wrapper.fit(solid.field, start)
        iou = voxel_iou(
            shape, wrapper.sphere.faces, mesh.vertices, mesh.faces, 0.01 * float(np.ptp(shape, axis=0).max())
        )
        if solid.leaks:
            note(f"{mesh.name}: open: holes were closed by what the surface hides")
        elif iou < 0.8:
            note(f"{mesh.name}: the template overlaps the mesh by {iou:.2f} only (inner walls count as outside there)")
        centre = (shape.max(0) + shape.min(0)) / 2 * [1, 0, 1]
        shapes.append(shape - centre)
        placed.append(mesh.moved(np.eye(3), -centre))
    return np.array(shapes), placed


def lay_template(wrapper: Wrapper, solid: MeshSolid) -> Floats:
    """Shrink the sphere (V, 3) onto a solid through ever finer closings of it, vertices spread evenly."""
    size, middle = np.ptp(solid.vertices, axis=0), (solid.vertices.min(0) + solid.vertices.max(0)) / 2
    vertices = wrapper.sphere.vertices * (0.6 * size) + middle
    for share in BALLS:
        closed = solid.closed(share * float(size.max()))
        vertices = wrapper.symmetrized(project(closed, vertices, 12))
        vertices = wrapper.relax(closed, vertices, _even, 60)
    vertices = wrapper.symmetrized(project(solid.field, vertices, 4))
    vertices = wrapper.relax(solid.field, vertices, _even, 20)
    return wrapper.fit(solid.field, vertices, smoothness=0.1, iterations=8)


def _even(points: Floats) -> Floats:
    """Ask for one density everywhere."""
    return np.ones(len(points))


def size_modes(mean: Floats, sigma: float) -> Floats:
    """Modes (3, V, 3) of length, width and height with a relative standard deviation; none (0, V, 3) at 0."""
    if sigma == 0:
        return np.zeros((0, *mean.shape))
    return sigma * np.eye(3)[:, None, :] * mean


def _check(name: str, paths: list[Path], options: MeshOptions) -> None:
    if not name or not all(c.isalnum() or c in " _-" for c in name):
        raise CategoryError(f"{name!r} is no category name: letters, digits, blanks, - and _ make one")
    if not paths:
        raise CategoryError("no meshes are named: at least one is needed")
    double = [p.stem for i, p in enumerate(paths) if p.stem in [q.stem for q in paths[:i]]]
    if double:
        raise CategoryError(f"two meshes are called {double[0]!r}: key points and notes go by the file's stem")


def _size_sigma(options: MeshOptions, count: int) -> float:
    if options.size_sigma is not None:
        return options.size_sigma
    return SIZE_SIGMA if count < MANY else 0.0


def _solid(mesh: NamedMesh) -> MeshSolid:
    solid = MeshSolid(mesh.vertices, mesh.faces)
    try:
        _ = solid.field
    except CategoryError as error:
        raise CategoryError(f"{mesh.name}: {error}") from None
    return solid


def _landmarks(first: NamedMesh, other: NamedMesh) -> tuple[Floats, Floats]:
    """Points of two meshes that mean the same: corners and middles of the box, and key points that both have."""
    steps = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), -1).reshape(-1, 3)
    both = []
    for mesh in (first, other):
        low, high = mesh.vertices.min(0), mesh.vertices.max(0)
        rows = [(low + high) / 2 + steps * (high - low) / 2]
        shared = [key for key in first.keypoints if key in other.keypoints]
        if shared:
            rows.append(np.array([mesh.keypoints[key] for key in shared]))
        both.append(np.concatenate(rows))
    return both[0], both[1]


def _turned_round(first: NamedMesh, first_solid: MeshSolid, other: NamedMesh, solid: MeshSolid) -> bool:
    """Whether a mesh, stretched to the first one's box, is more like it when turned by 180 degrees."""
    shared = [key for key in first.keypoints if key in other.keypoints]
    if len(shared) >= 2:
        a, b = (np.array([mesh.keypoints[key][:2] for key in shared]) for mesh in (first, other))
        spread_a, spread_b = a - a.mean(0), b - b.mean(0)
        return bool((spread_a * spread_b).sum() < 0)
    steps = np.linspace(-0.49, 0.49, 40)
    unit = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3)
    within = first_solid.field(unit * np.ptp(first.vertices, axis=0)) < 0
    overlaps = []
    for way in (1.0, -1.0):
        there = solid.field(unit * [way, way, 1] * np.ptp(other.vertices, axis=0)) < 0
        overlaps.append((within & there).sum() / max(1, (within | there).sum()))
    return bool(overlaps[1] > overlaps[0] + TURNED_BETTER)


def _keypoint_weights(wrapper: Wrapper, shapes: Floats, meshes: list[NamedMesh]) -> tuple[tuple[str, ...], Floats]:
    known = [i for i, mesh in enumerate(meshes) if mesh.keypoints]
    if not known:
        return (), np.zeros((0, len(wrapper.sphere.vertices)))
    names = tuple(meshes[known[0]].keypoints)
    points = np.array([[meshes[i].keypoints[key] for key in names] for i in known])
    for row, key in enumerate(names):  # a left point and its right twin are each other's mirror image
        twin = key.replace("right", "left")
        if twin != key and twin in names:
            left = names.index(twin)
            points[:, left] = (points[:, left] + points[:, row] * FLIP) / 2
            points[:, row] = points[:, left] * FLIP
    return names, mirrored_weights(point_weights(shapes[known], points), wrapper.sphere.mirror, names)
