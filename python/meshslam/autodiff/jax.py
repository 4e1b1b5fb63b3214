"""Losses of meshes as JAX functions: differentiable in vertices and poses, under `jit` and `vmap`, on the CPU.

Shapes, conventions and what is exact: `docs/autodiff.md`. Leading dimensions `...` of all arguments broadcast. Values
are float32, or float64 where `jax_enable_x64` is set. What cannot be used (NaN, a face that names no vertex) is JAX's
own error with the core's words when the function runs, a wrong shape a GeometryError when it is traced.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from meshslam.autodiff.batches import NO_SECOND, Method, Part, checked_method, leading_shape
from meshslam.autodiff.scenes import Mesh, seen_shares, share_iou
from meshslam.errors import GeometryError, MeshslamError
from meshslam.geometry import (
    Cameras,
    Intrinsics,
    ViewLosses,
    batched_keypoint_loss,
    batched_mask_loss,
    batched_silhouette_gradients,
    batched_silhouettes,
    intrinsics_of,
    occlusion_order,
)

try:
    import jax
    import jax.numpy as jnp
    from jax.scipy.linalg import expm
except ImportError as error:
    raise MeshslamError(
        "meshslam.autodiff.jax needs JAX, which is not installed: pip install 'meshslam[jax]'"
    ) from error

Array = Any  # jax.Array, or what becomes one


def mask_iou_loss(
    vertices: Array,
    faces: Array,
    camera_from_object: Array,
    camera: Cameras,
    masks: Array,
    *,
    gradient: Method = "exact",
    threads: int = 0,
) -> Array:
    """-IoU of meshes (..., V, 3) against masks (..., h, w) in each view, (...), from -1 to 0.

    `exact`: areas and their gradient; `kato`: pixel counts and the paper's approximate gradient (Kato, Ushiku and
    Harada 2018). Differentiable in `vertices`, metres, and `camera_from_object` (..., 4, 4), over each of its first
    twelve entries. `masks`: bool, uint8 (0, or in the mask), or shares from 0 to 1. `threads`: of the core, 0 for all.
    """
    cameras = intrinsics_of(camera)
    size = (cameras.height, cameras.width)
    operands = _operands(vertices, faces, camera_from_object, cameras, [("masks", jnp.asarray(masks), size)])
    return _loss(_Masks(checked_method(gradient), threads), *operands)


def keypoint_loss(
    vertices: Array,
    association: Array,
    camera_from_object: Array,
    camera: Cameras,
    observed: Array,
    visible: Array,
    *,
    threads: int = 0,
) -> Array:
    """Sum of squared distances, squared pixels, of projected key points to `observed` (..., K, 2).

    Only those that are `visible` (..., K) count; the others may be NaN. Key point k lies at association[:, k]^T V, with
    `association` (V, K). One loss a view, (...), differentiable in `vertices` (..., V, 3) and `camera_from_object`
    (..., 4, 4).
    """
    cameras = intrinsics_of(camera)
    count = jnp.shape(association)[-1]
    leading_shape([("visible", jnp.shape(visible), (count,)), ("observed", jnp.shape(observed), (count, 2))])
    pixels = jnp.asarray(observed)
    flags = jnp.broadcast_to(jnp.asarray(visible, pixels.dtype)[..., None], (*pixels.shape[:-1], 1))
    seen = jnp.concatenate([pixels, flags], axis=-1)  # one array, so that both are batched alike
    operands = _operands(vertices, association, camera_from_object, cameras, [("observed", seen, (count, 3))])
    return _loss(_Keypoints(threads), *operands)


def silhouettes(
    vertices: Array, faces: Array, camera_from_object: Array, camera: Cameras, *, threads: int = 0
) -> Array:
    """How much of each pixel a mesh covers, (..., h, w), 0 to 1: exact areas, differentiable like `mask_iou_loss`."""
    cameras = intrinsics_of(camera)
    operands = _operands(vertices, faces, camera_from_object, cameras, [])
    return _silhouettes(_Size(cameras.width, cameras.height, threads), *operands)


def scene_silhouettes(meshes: Sequence[Mesh], camera: Cameras, *, threads: int = 0) -> Array:
    """How much of each pixel shows each of several objects that hide each other, (..., n, h, w).

    Each mesh is (vertices (..., V, 3), faces (F, 3), camera_from_object (..., 4, 4)). Exact, and differentiable, where
    of two objects one is in front wherever both are drawn: `occlusion_order` decides which; else the nearer one in most
    pixels counts as in front everywhere.
    """
    cameras = intrinsics_of(camera)
    placed = [(jnp.asarray(v), jnp.asarray(f), jnp.asarray(pose)) for v, f, pose in meshes]
    arrays = Intrinsics(jnp.asarray(cameras.values), cameras.width, cameras.height)

    def hidden_by(points: Array, faces: Array, counts: tuple[int, ...]) -> Array:
        batch = np.broadcast_shapes(points.shape[:-2], arrays.values.shape[:-1])
        shape = jax.ShapeDtypeStruct((*batch, len(counts), len(counts)), bool)
        values = arrays.values.reshape((1,) * (len(batch) + 1 - arrays.values.ndim) + arrays.values.shape)
        faces = faces.reshape((1,) * len(batch) + faces.shape)

        return _call(_order, (_Size(cameras.width, cameras.height, threads), counts), shape, points, faces, values)

    def draw(points: Array, faces: Array, camera: Intrinsics) -> Array:
        return silhouettes(points, faces, jnp.eye(4, dtype=points.dtype), camera, threads=threads)

    return seen_shares(jnp, draw, hidden_by, jax.lax.stop_gradient, placed, arrays)


def scene_mask_iou_loss(meshes: Sequence[Mesh], camera: Cameras, masks: Array, *, threads: int = 0) -> Array:
    """-IoU of what `scene_silhouettes` shows of each object against its mask (..., n, h, w): (..., n)."""
    shares, seen = scene_silhouettes(meshes, camera, threads=threads), jnp.asarray(masks)
    if not jnp.issubdtype(seen.dtype, jnp.floating):
        seen = seen != 0
    return share_iou(jnp, shares, seen.astype(shares.dtype))


def exp_se3(tangent: Array) -> Array:
    """Rigid transforms (..., 4, 4) of tangent vectors (..., 6), (translation, rotation), as `Pose.exp` has them."""
    return _exponential(jnp.asarray(tangent))


def _exponential_of(x: Array) -> Array:
    (a, b, c), (p, q, r) = jnp.moveaxis(x[..., :3], -1, 0), jnp.moveaxis(x[..., 3:], -1, 0)
    o = jnp.zeros_like(a)
    rows = [jnp.stack(row, -1) for row in ((o, -r, q, a), (r, o, -p, b), (-q, p, o, c), (o, o, o, o))]
    return jnp.vectorize(expm, signature="(n,n)->(n,n)")(jnp.stack(rows, -2))


_exponential = jax.jit(_exponential_of)


@dataclass(frozen=True)
class _Masks:
    """The mask loss; what is observed are masks."""

    gradient: Method
    threads: int

    def __call__(self, vertices: Array, faces: Array, *rest: Array, with_gradient: bool) -> ViewLosses:
        pose, intrinsics, masks = rest
        size = masks.shape[:-3:-1]
        return batched_mask_loss(
            vertices,
            _one("faces", faces),
            pose,
            Intrinsics(intrinsics, *size),
            masks,
            gradient=self.gradient,
            with_gradient=with_gradient,
            threads=self.threads,
        )


@dataclass(frozen=True)
class _Keypoints:
    """The key point loss; what is observed are pixels, and in a third column whether they are visible."""

    threads: int

    def __call__(self, vertices: Array, association: Array, *rest: Array, with_gradient: bool) -> ViewLosses:
        pose, intrinsics, seen = rest
        weights, camera = _one("association", association), Intrinsics(intrinsics, 1, 1)
        return batched_keypoint_loss(
            vertices, weights, pose, camera, seen[..., :2], seen[..., 2] != 0, threads=self.threads
        )


@dataclass(frozen=True)
class _Size:
    """Of the pictures that silhouettes are drawn into."""

    width: int
    height: int
    threads: int


def _operands(
    vertices: Array, structure: Array, pose: Array, cameras: Intrinsics, seen: list[tuple[str, Array, tuple[int, int]]]
) -> list[Array]:
    """Operands with as many leading dimensions each as the batch has, so that `vmap` adds its own in front of all."""
    values = jnp.asarray(cameras.values)
    parts: list[Part] = [("vertices", jnp.shape(vertices), (None, 3)), ("camera_from_object", jnp.shape(pose), (4, 4))]
    parts += [("intrinsics", values.shape, (5,)), *((name, jnp.shape(array), ends) for name, array, ends in seen)]
    rank = len(leading_shape(parts))

    def padded(array: Array, own: int) -> Array:
        return jnp.reshape(array, (1,) * (rank + own - jnp.ndim(array)) + jnp.shape(array))

    leading_shape([("faces or association", jnp.shape(structure)[-2:], (None, None))])
    kind = jnp.promote_types(jnp.result_type(vertices, pose), jnp.float32)
    points, matrices = (jnp.asarray(array, kind) for array in (vertices, pose))
    operands = [padded(points, 2), padded(jnp.asarray(structure), 2), padded(matrices, 2), padded(values, 1)]
    return operands + [padded(array, 2) for _, array, _ in seen]


def _batch(vertices: Array, pose: Array, intrinsics: Array, *seen: Array) -> tuple[int, ...]:
    return np.broadcast_shapes(
        vertices.shape[:-2], pose.shape[:-2], intrinsics.shape[:-1], *(s.shape[:-2] for s in seen)
    )


def _one(name: str, array: Array) -> Array:
    """An operand that all views share, without its leading dimensions."""
    if any(n != 1 for n in array.shape[:-2]):
        raise GeometryError(f"{name} are those of every view: vmap cannot map over them")
    return array.reshape(array.shape[-2:])


@dataclass(frozen=True)
class _OnArrays:
    """A function of NumPy's arrays with its settings: JAX keeps what it compiles for each, and equal ones are one."""

    function: Callable[..., Any]  # of a module, not a closure
    settings: tuple[Any, ...]

    def __call__(self, *given: Array) -> Any:  # noqa: ANN401 # a tree of arrays
        return self.function(*self.settings, *(np.asarray(array) for array in given))


def _call(function: Callable[..., Any], settings: tuple[Any, ...], shapes: Any, *operands: Array) -> Any:  # noqa: ANN401
    """Run a function when the values are there."""
    return jax.pure_callback(_OnArrays(function, settings), shapes, *operands, vmap_method="expand_dims")


def _losses(kind: _Masks | _Keypoints, with_gradient: bool, *arrays: Array) -> list[Array]:
    found = kind(*arrays, with_gradient=with_gradient)
    return [found.losses, found.vertices, found.camera_from_object][: 3 if with_gradient else 1]


def _drawn(size: _Size, points: Array, faces: Array, pose: Array, intrinsics: Array) -> Array:
    camera = Intrinsics(intrinsics, size.width, size.height)
    return batched_silhouettes(points, _one("faces", faces), pose, camera, threads=size.threads)


def _gradients(size: _Size, slopes: Array, points: Array, faces: Array, pose: Array, intrinsics: Array) -> list[Array]:
    camera, one = Intrinsics(intrinsics, size.width, size.height), _one("faces", faces)
    return list(batched_silhouette_gradients(points, one, pose, camera, slopes, threads=size.threads))


def _order(size: _Size, counts: tuple[int, ...], points: Array, faces: Array, intrinsics: Array) -> Array:
    return occlusion_order(points, _one("faces", faces), counts, Intrinsics(intrinsics, size.width, size.height))


@partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def _evaluated(kind: _Masks | _Keypoints, with_gradient: bool, *operands: Array) -> Any:  # noqa: ANN401
    """Losses, and with them their gradients over vertices and poses in each view."""
    vertices, _, *rest = operands
    batch, of = _batch(vertices, *rest), vertices.dtype
    shapes = [jax.ShapeDtypeStruct(batch, of)]
    if with_gradient:
        ends = (vertices.shape[-2:], (4, 4))
        shapes += [jax.ShapeDtypeStruct((*batch, *end), of) for end in ends]

    return _call(_losses, (kind, with_gradient), shapes, *operands)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _pulled_back(size: _Size, slopes: Array, *operands: Array) -> Any:  # noqa: ANN401
    """Gradients over vertices and poses in each view, from slopes over silhouettes."""
    vertices = operands[0]
    ends = (vertices.shape[-2:], (4, 4))
    shapes = [jax.ShapeDtypeStruct((*slopes.shape[:-2], *end), vertices.dtype) for end in ends]

    return _call(_gradients, (size,), shapes, slopes, *operands)


def _refuse(*_: Any) -> Any:  # noqa: ANN401
    raise NotImplementedError(NO_SECOND)


_evaluated.defjvp(_refuse)
_pulled_back.defjvp(_refuse)


def _shared(gradient: Array, operand: Array) -> Array:
    """Sum over the views that share an operand."""
    missing = [axis for axis, n in enumerate(operand.shape) if n == 1 and gradient.shape[axis] != 1]
    return jnp.sum(gradient, axis=tuple(missing), keepdims=True)


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def _loss(kind: _Masks | _Keypoints, *operands: Array) -> Array:
    return _evaluated(kind, False, *operands)[0]


def _loss_forward(kind: _Masks | _Keypoints, *operands: Array) -> tuple[Array, Any]:
    loss, of_vertices, of_pose = _evaluated(kind, True, *operands)
    return loss, (of_vertices, of_pose, operands)


def _loss_backward(_: _Masks | _Keypoints, kept: Any, slope: Array) -> tuple[Array, ...]:  # noqa: ANN401
    of_vertices, of_pose, (vertices, _, pose, *rest) = kept
    by = slope[..., None, None]
    return (_shared(by * of_vertices, vertices), None, _shared(by * of_pose, pose), *(None for _ in rest))


_loss.defvjp(_loss_forward, _loss_backward)


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def _silhouettes(size: _Size, *operands: Array) -> Array:
    vertices, _, *rest = operands
    shape = jax.ShapeDtypeStruct((*_batch(vertices, *rest), size.height, size.width), vertices.dtype)

    return _call(_drawn, (size,), shape, *operands)


def _silhouettes_forward(size: _Size, *operands: Array) -> tuple[Array, Any]:
    return _silhouettes(size, *operands), operands


def _silhouettes_backward(size: _Size, operands: Any, slopes: Array) -> tuple[Array, ...]:  # noqa: ANN401
    vertices, _, pose, _ = operands
    of_vertices, of_pose = _pulled_back(size, slopes, *operands)
    return _shared(of_vertices, vertices), None, _shared(of_pose, pose), None


_silhouettes.defvjp(_silhouettes_forward, _silhouettes_backward)
