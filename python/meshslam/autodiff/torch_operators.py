"""The operators of `meshslam.autodiff.torch`, registered as `torch.ops.meshslam`.

Each is an implementation on NumPy's view of the tensors, and two ways to call it: an `autograd.Function`, which eager
mode takes because it costs less, and a registered operator for `torch.compile` and `torch.export`.
Gradients are computed with the losses and kept; going back multiplies them by the losses' slopes.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.autograd import Function
from torch.library import custom_op

from meshslam.autodiff.batches import NO_SECOND
from meshslam.geometry import (
    Intrinsics,
    ViewLosses,
    batched_keypoint_loss,
    batched_mask_loss,
    batched_silhouette_gradients,
    batched_silhouettes,
    occlusion_order,
    summed_over_views,
)

Three = tuple[Tensor, Tensor, Tensor]


def mask_iou(
    vertices: Tensor,
    faces: Tensor,
    pose: Tensor,
    intrinsics: Tensor,
    masks: Tensor,
    gradient: str,
    with_gradient: bool,
    threads: int,
) -> Three:
    """Losses (...) and, if they are wanted, gradients over vertices and pose in each view."""
    camera = Intrinsics(_array(intrinsics), masks.shape[-1], masks.shape[-2])
    arrays = (_array(vertices), _array(faces), _array(pose), camera, _array(masks))
    found = batched_mask_loss(*arrays, gradient=gradient, with_gradient=with_gradient, threads=threads)  # type: ignore[arg-type]
    return _outputs(found)


def keypoints(
    vertices: Tensor,
    association: Tensor,
    pose: Tensor,
    intrinsics: Tensor,
    observed: Tensor,
    visible: Tensor,
    with_gradient: bool,
    threads: int,
) -> Three:
    """The same of the key point loss."""
    camera = Intrinsics(_array(intrinsics), 1, 1)
    arrays = (_array(vertices), _array(association), _array(pose), camera, _array(observed), _array(visible))
    found = batched_keypoint_loss(*arrays, threads=threads)
    return _outputs(found if with_gradient else ViewLosses(found.losses, None, None))


def silhouettes(
    vertices: Tensor, faces: Tensor, pose: Tensor, intrinsics: Tensor, width: int, height: int, threads: int
) -> Tensor:
    """Shares of pixels (..., h, w)."""
    camera = Intrinsics(_array(intrinsics), width, height)
    arrays = (_array(vertices), _array(faces), _array(pose), camera)
    return torch.from_numpy(batched_silhouettes(*arrays, threads=threads))


def hidden_by(points: Tensor, faces: Tensor, intrinsics: Tensor, counts: list[int], width: int, height: int) -> Tensor:
    """Which object hides which, (..., n, n)."""
    camera = Intrinsics(_array(intrinsics), width, height)
    return torch.from_numpy(occlusion_order(_array(points), _array(faces), tuple(counts), camera))


def loss_backward(
    slopes: Tensor, of_vertices: Tensor, of_pose: Tensor, vertices: Tensor, pose: Tensor
) -> tuple[Tensor, Tensor]:
    """Gradients of each view, times the slope of its loss, summed over the views that share vertices or a pose."""
    weights = _array(slopes)
    return _sum(_array(of_vertices), vertices, weights), _sum(_array(of_pose), pose, weights)


def silhouettes_backward(
    slopes: Tensor, vertices: Tensor, faces: Tensor, pose: Tensor, intrinsics: Tensor, threads: int
) -> tuple[Tensor, Tensor]:
    """Gradients from slopes over the shares, summed over the views that share vertices or a pose."""
    camera = Intrinsics(_array(intrinsics), slopes.shape[-1], slopes.shape[-2])
    arrays = (_array(vertices), _array(faces), _array(pose), camera, _array(slopes))
    of_vertices, of_pose = batched_silhouette_gradients(*arrays, threads=threads)
    return _sum(of_vertices, vertices), _sum(of_pose, pose)


def _array(tensor: Tensor) -> Any:  # noqa: ANN401 # NumPy's view of the same memory
    return tensor.detach().numpy()


def _outputs(found: ViewLosses) -> Three:
    """Losses and gradients; without gradients, empty ones."""
    first, second = (
        torch.empty(0) if part is None else torch.from_numpy(part)
        for part in (found.vertices, found.camera_from_object)
    )
    return torch.from_numpy(found.losses), first, second


def _sum(gradients: Any, operand: Tensor, weights: Any = None) -> Tensor:  # noqa: ANN401 # arrays
    return torch.from_numpy(summed_over_views(gradients, tuple(operand.shape[:-2]), weights))


OPERATORS = {
    function: custom_op(f"meshslam::{function.__name__}", mutates_args=(), device_types="cpu")(function)
    for function in (mask_iou, keypoints, silhouettes, hidden_by, loss_backward, silhouettes_backward)
}


def _fake_loss(vertices: Tensor, _: Tensor, pose: Tensor, intrinsics: Tensor, seen: Tensor, *rest: Any) -> Three:  # noqa: ANN401
    with_gradient = rest[-2]
    leading = (vertices.shape[:-2], pose.shape[:-2], intrinsics.shape[:-1], seen.shape[:-2])
    batch = torch.broadcast_shapes(*leading, *(extra.shape[:-1] for extra in rest if isinstance(extra, Tensor)))
    ends = [(*batch, *vertices.shape[-2:]), (*batch, 4, 4)] if with_gradient else [(0,), (0,)]
    kind = {} if with_gradient else {"dtype": torch.get_default_dtype()}
    return vertices.new_empty(batch), vertices.new_empty(ends[0], **kind), vertices.new_empty(ends[1], **kind)


def _fake_silhouettes(
    vertices: Tensor, faces: Tensor, pose: Tensor, intrinsics: Tensor, width: int, height: int, threads: int
) -> Tensor:
    batch = torch.broadcast_shapes(vertices.shape[:-2], pose.shape[:-2], intrinsics.shape[:-1])
    return vertices.new_empty((*batch, height, width))


def _fake_order(
    points: Tensor, faces: Tensor, intrinsics: Tensor, counts: list[int], width: int, height: int
) -> Tensor:
    batch = torch.broadcast_shapes(points.shape[:-2], intrinsics.shape[:-1])
    return points.new_empty((*batch, len(counts), len(counts)), dtype=torch.bool)


def _fake_loss_backward(
    slopes: Tensor, of_vertices: Tensor, of_pose: Tensor, vertices: Tensor, pose: Tensor
) -> tuple[Tensor, Tensor]:
    return vertices.new_empty(vertices.shape), pose.new_empty(pose.shape)


def _fake_silhouettes_backward(
    slopes: Tensor, vertices: Tensor, faces: Tensor, pose: Tensor, intrinsics: Tensor, threads: int
) -> tuple[Tensor, Tensor]:
    return vertices.new_empty(vertices.shape), pose.new_empty(pose.shape)


def _keep_loss(ctx: Any, inputs: tuple[Any, ...], output: Three) -> None:  # noqa: ANN401
    ctx.set_materialize_grads(False)  # the gradients that are handed out beside the losses have none
    ctx.others = len(inputs) - 3
    ctx.save_for_backward(output[1], output[2], inputs[0], inputs[2])


def _from_loss(ctx: Any, slopes: Tensor | None, *_: Any) -> tuple[Tensor | None, ...]:  # noqa: ANN401
    rest: list[Tensor | None] = [None] * ctx.others
    if slopes is None:
        return None, None, None, *rest
    first, second = _run(loss_backward, slopes, *ctx.saved_tensors)
    return first, None, second, *rest


def _keep_inputs(ctx: Any, inputs: tuple[Any, ...], output: Tensor) -> None:  # noqa: ANN401
    ctx.threads = inputs[-1]
    ctx.save_for_backward(*inputs[:4])


def _from_silhouettes(ctx: Any, slopes: Tensor) -> tuple[Tensor | None, ...]:  # noqa: ANN401
    first, second = _run(silhouettes_backward, slopes, *ctx.saved_tensors, ctx.threads)
    return first, None, second, None, None, None, None


def _refuse(ctx: Any, *slopes: Tensor) -> None:  # noqa: ANN401
    raise NotImplementedError(NO_SECOND)


for _function, _fake in (
    (mask_iou, _fake_loss),
    (keypoints, _fake_loss),
    (silhouettes, _fake_silhouettes),
    (hidden_by, _fake_order),
    (loss_backward, _fake_loss_backward),
    (silhouettes_backward, _fake_silhouettes_backward),
):
    OPERATORS[_function].register_fake(_fake)
OPERATORS[mask_iou].register_autograd(_from_loss, setup_context=_keep_loss)
OPERATORS[keypoints].register_autograd(_from_loss, setup_context=_keep_loss)
OPERATORS[silhouettes].register_autograd(_from_silhouettes, setup_context=_keep_inputs)
OPERATORS[loss_backward].register_autograd(_refuse)
OPERATORS[silhouettes_backward].register_autograd(_refuse)


class _MaskIou(Function):
    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> Tensor:  # noqa: ANN401
        return _kept(ctx, inputs, mask_iou(*inputs))

    backward = staticmethod(_from_loss)


class _Keypoints(Function):
    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> Tensor:  # noqa: ANN401
        return _kept(ctx, inputs, keypoints(*inputs))

    backward = staticmethod(_from_loss)


class _Silhouettes(Function):
    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> Tensor:  # noqa: ANN401
        output = silhouettes(*inputs)
        _keep_inputs(ctx, inputs, output)
        return output

    backward = staticmethod(_from_silhouettes)


def _kept(ctx: Any, inputs: tuple[Any, ...], output: Three) -> Tensor:  # noqa: ANN401
    _keep_loss(ctx, inputs, output)
    return output[0]


FUNCTIONS: dict[Any, Any] = {mask_iou: _MaskIou, keypoints: _Keypoints}


def _is_plain(tensor: Tensor) -> bool:
    """Whether nothing but eager mode asks: no tracer, no subclass."""
    return type(tensor) in (Tensor, torch.nn.Parameter) and not torch.compiler.is_compiling()


def loss(function: Any, *arguments: Any) -> Tensor:  # noqa: ANN401
    """A loss in each view, differentiable."""
    if _is_plain(arguments[0]):
        return FUNCTIONS[function].apply(*arguments)
    return OPERATORS[function](*arguments)[0]


def drawn(*arguments: Any) -> Tensor:  # noqa: ANN401
    """Silhouettes, differentiable."""
    return (_Silhouettes.apply if _is_plain(arguments[0]) else OPERATORS[silhouettes])(*arguments)


def _run(function: Any, *arguments: Any) -> Any:  # noqa: ANN401
    """A way back; with the registered operator it can be traced, and differentiating again is refused."""
    plain = _is_plain(arguments[0]) and not torch.is_grad_enabled()
    return (function if plain else OPERATORS[function])(*arguments)
