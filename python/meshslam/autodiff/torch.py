"""Losses of meshes as PyTorch operators: differentiable in vertices and poses, under `torch.compile`, on the CPU.

Shapes, conventions and what is exact: `docs/autodiff.md`. Leading dimensions `...` of all arguments broadcast. Tensors
are float64 or float32 on the CPU, in any strides; contiguous ones are not copied. What cannot be used (NaN, a face that
names no vertex) is a GeometryError. The operators are registered as `torch.ops.meshslam`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from meshslam.autodiff.batches import Method, checked_method
from meshslam.autodiff.scenes import Mesh, seen_shares, share_iou
from meshslam.errors import GeometryError, MeshslamError
from meshslam.geometry import Cameras, Intrinsics, intrinsics_of

try:
    import torch
    from torch import Tensor

    from meshslam.autodiff import torch_operators as operators
except ImportError as error:
    raise MeshslamError(
        "meshslam.autodiff.torch needs PyTorch, which is not installed: pip install 'meshslam[torch]'"
    ) from error


def mask_iou_loss(
    vertices: Tensor,
    faces: Tensor,
    camera_from_object: Tensor,
    camera: Cameras,
    masks: Tensor,
    *,
    gradient: Method = "exact",
    threads: int = 0,
) -> Tensor:
    """-IoU of meshes (..., V, 3) against masks (..., h, w) in each view, (...), from -1 to 0.

    `exact`: areas and their gradient; `kato`: pixel counts and the paper's approximate gradient (Kato, Ushiku and
    Harada 2018). Differentiable in `vertices`, metres, and `camera_from_object` (..., 4, 4), over each of its first
    twelve entries. `masks`: bool, uint8 (0, or in the mask), or shares from 0 to 1. `threads`: of the core, 0 for all.
    """
    cameras = intrinsics_of(camera)
    points, pose = _of_one_type(vertices, camera_from_object)
    _check(points, pose, faces=faces, masks=masks)
    if masks.shape[-2:] != (cameras.height, cameras.width):
        size = f"{cameras.height}, {cameras.width}"
        raise GeometryError(f"masks have shape {tuple(masks.shape)}, expected (..., {size}), the camera's image")
    operands = (points, faces, pose, _tensor(cameras), masks)
    return operators.loss(operators.mask_iou, *operands, checked_method(gradient), _wanted(points, pose), threads)


def keypoint_loss(
    vertices: Tensor,
    association: Tensor,
    camera_from_object: Tensor,
    camera: Cameras,
    observed: Tensor,
    visible: Tensor,
    *,
    threads: int = 0,
) -> Tensor:
    """Sum of squared distances, squared pixels, of projected key points to `observed` (..., K, 2).

    Only those that are `visible` (..., K) count; the others may be NaN. Key point k lies at association[:, k]^T V, with
    `association` (V, K). One loss a view, (...), differentiable in `vertices` (..., V, 3) and `camera_from_object`
    (..., 4, 4).
    """
    cameras = intrinsics_of(camera)
    points, pose = _of_one_type(vertices, camera_from_object)
    _check(points, pose, association=association, observed=observed, visible=visible)
    operands = (points, association, pose, _tensor(cameras), observed, visible)
    return operators.loss(operators.keypoints, *operands, _wanted(points, pose), threads)


def silhouettes(
    vertices: Tensor, faces: Tensor, camera_from_object: Tensor, camera: Cameras, *, threads: int = 0
) -> Tensor:
    """How much of each pixel a mesh covers, (..., h, w), 0 to 1: exact areas, differentiable like `mask_iou_loss`."""
    cameras = intrinsics_of(camera)
    points, pose = _of_one_type(vertices, camera_from_object)
    _check(points, pose, faces=faces)
    return operators.drawn(points, faces, pose, _tensor(cameras), cameras.width, cameras.height, threads)


def scene_silhouettes(meshes: Sequence[Mesh], camera: Cameras, *, threads: int = 0) -> Tensor:
    """How much of each pixel shows each of several objects that hide each other, (..., n, h, w).

    Each mesh is (vertices (..., V, 3), faces (F, 3), camera_from_object (..., 4, 4)). Exact, and differentiable, where
    of two objects one is in front wherever both are drawn: `occlusion_order` decides which; else the nearer one in most
    pixels counts as in front everywhere.
    """
    cameras = intrinsics_of(camera)
    poses = [_of_one_type(vertices, pose) for vertices, _, pose in meshes]
    placed = [(points, corners, pose) for (points, pose), (_, corners, _) in zip(poses, meshes, strict=True)]
    for points, corners, pose in placed:
        _check(points, pose, faces=corners)
    tensor = Intrinsics(_tensor(cameras), cameras.width, cameras.height)

    def hidden_by(points: Tensor, faces: Tensor, counts: tuple[int, ...]) -> Tensor:
        size = (cameras.width, cameras.height)
        return operators.OPERATORS[operators.hidden_by](points, faces, tensor.values, list(counts), *size)

    def draw(points: Tensor, faces: Tensor, camera: Intrinsics) -> Tensor:
        return silhouettes(points, faces, torch.eye(4, dtype=points.dtype), camera, threads=threads)

    return seen_shares(torch, draw, hidden_by, Tensor.detach, placed, tensor)


def scene_mask_iou_loss(meshes: Sequence[Mesh], camera: Cameras, masks: Tensor, *, threads: int = 0) -> Tensor:
    """-IoU of what `scene_silhouettes` shows of each object against its mask (..., n, h, w): (..., n)."""
    shares = scene_silhouettes(meshes, camera, threads=threads)
    seen = masks if masks.is_floating_point() else masks != 0
    return share_iou(torch, shares, seen.to(shares.dtype))


def exp_se3(tangent: Tensor) -> Tensor:
    """Rigid transforms (..., 4, 4) of tangent vectors (..., 6), (translation, rotation), as `Pose.exp` has them."""
    a, b, c, p, q, r = tangent.unbind(-1)
    o = torch.zeros_like(a)
    rows = [torch.stack(row, -1) for row in ((o, -r, q, a), (r, o, -p, b), (-q, p, o, c), (o, o, o, o))]
    return torch.linalg.matrix_exp(torch.stack(rows, -2))


def _of_one_type(vertices: Tensor, pose: Tensor) -> tuple[Tensor, Tensor]:
    kind = torch.promote_types(vertices.dtype, pose.dtype)
    if kind not in (torch.float32, torch.float64):
        raise GeometryError(f"vertices and camera_from_object must be float64 or float32, found {kind}")
    return vertices.to(kind), pose.to(kind)


def _tensor(cameras: Intrinsics) -> Tensor:
    values = cameras.values
    return values if isinstance(values, Tensor) else torch.from_numpy(np.ascontiguousarray(values, np.float64))


def _wanted(vertices: Tensor, pose: Tensor) -> bool:
    return bool(torch.is_grad_enabled() and (vertices.requires_grad or pose.requires_grad))


def _check(vertices: Tensor, pose: Tensor, **constant: Tensor) -> None:
    """GeometryError for another device, or a gradient that is not had; the core checks shapes and values."""
    for name, tensor in {"vertices": vertices, "camera_from_object": pose, **constant}.items():
        if tensor.device.type != "cpu":
            raise GeometryError(f"{name} are on {tensor.device}, the core computes on the CPU: pass {name}.cpu()")
        if name in constant and tensor.requires_grad:
            raise GeometryError(f"there is no gradient over {name}: pass {name}.detach()")
