"""What PyTorch alone asks of operators."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra `torch` is not installed: make test-torch")

from meshslam.autodiff import torch as losses  # noqa: E402
from meshslam.autodiff import torch_operators as operators  # noqa: E402
from meshslam.errors import GeometryError  # noqa: E402
from meshslam.geometry import Camera, intrinsics_of  # noqa: E402
from tests.autodiff.frameworks import ASSOCIATION, FACES, VERTICES, scene  # noqa: E402

OCTAHEDRON = torch.tensor([[1.0, 0, 0], [-1, 0, 0], [0, 0.8, 0], [0, -0.8, 0], [0, 0, 0.7], [0, 0, -0.7]]).double()
EIGHT = torch.tensor([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])
SMALL = Camera(14, 11, 12.0, 12.5, 6.2, 5.1, 0.3)
POSES = torch.tensor(scene(2)[0])
MASKS = torch.rand((2, 11, 14), generator=torch.Generator().manual_seed(1)).double()
ARGUMENTS = (OCTAHEDRON.clone().requires_grad_(), POSES.clone().requires_grad_())


@pytest.mark.parametrize("shared", [True, False])
def test_gradcheck(shared):
    pixels, visible = torch.full((3, 2), 5.0).double(), torch.tensor([True, False, True])
    weights = torch.eye(6, 3).double()
    vertices = ARGUMENTS[0] if shared else OCTAHEDRON.expand(2, 6, 3).clone().requires_grad_()
    for function in (
        lambda v, p: losses.mask_iou_loss(v, EIGHT, p, SMALL, MASKS),
        lambda v, p: losses.silhouettes(v, EIGHT, p, SMALL),
        lambda v, p: losses.keypoint_loss(v, weights, p, SMALL, pixels, visible),
    ):
        assert torch.autograd.gradcheck(function, (vertices, ARGUMENTS[1]), eps=1e-6, atol=1e-5)


@pytest.mark.filterwarnings("ignore:.*torch.*:FutureWarning", "ignore:The .grad attribute:UserWarning")  # its own
def test_the_operators_keep_what_pytorch_asks_of_them():
    intrinsics = torch.tensor(intrinsics_of(SMALL).values)
    vertices, pose = ARGUMENTS
    pixels, visible = torch.zeros((3, 2)).double(), torch.ones(3, dtype=torch.bool)
    iou = operators.OPERATORS[operators.mask_iou]
    torch.library.opcheck(iou, (vertices, EIGHT, pose, intrinsics, MASKS, "exact", True, 1))
    torch.library.opcheck(iou, (vertices.detach(), EIGHT, pose.detach(), intrinsics, MASKS, "exact", False, 1))
    torch.library.opcheck(operators.OPERATORS[operators.silhouettes], (vertices, EIGHT, pose, intrinsics, 14, 11, 1))
    keypoints = (vertices, torch.eye(6, 3).double(), pose, intrinsics, pixels, visible, True, 1)
    torch.library.opcheck(operators.OPERATORS[operators.keypoints], keypoints)


def test_eager_mode_and_the_registered_operators_give_the_same_bits():
    poses, cameras, masks = scene(4)
    vertices, pose = torch.tensor(VERTICES, requires_grad=True), torch.tensor(poses, requires_grad=True)
    rest = (torch.tensor(FACES), torch.tensor(intrinsics_of(cameras).values), torch.tensor(masks))
    eager = losses.mask_iou_loss(vertices, rest[0], pose, cameras, rest[2])
    registered = torch.ops.meshslam.mask_iou(vertices, rest[0], pose, rest[1], rest[2], "exact", True, 1)[0]
    assert torch.equal(eager, registered)
    for first, second in zip(
        *(torch.autograd.grad(x.sum(), (vertices, pose)) for x in (eager, registered)), strict=True
    ):
        assert torch.equal(first, second)


def test_the_sum_over_views_is_that_of_a_loop_to_the_last_bit():
    poses, cameras, masks = scene(6)
    faces = torch.tensor(FACES)
    whole, looped = (torch.tensor(VERTICES, requires_grad=True) for _ in range(2))
    losses.mask_iou_loss(whole, faces, torch.tensor(poses), cameras, torch.tensor(masks)).sum().backward()
    for k in range(6):
        pose, mask = torch.tensor(poses[k]), torch.tensor(masks[k])
        losses.mask_iou_loss(looped, faces, pose, cameras[k], mask).backward()
    assert torch.equal(whole.grad, looped.grad)


def test_a_gradient_that_may_be_differentiated_again_is_the_same_until_it_is():
    vertices, pose = ARGUMENTS
    loss = losses.mask_iou_loss(vertices, EIGHT, pose, SMALL, MASKS).sum()
    (kept,) = torch.autograd.grad(loss, vertices, create_graph=True)
    assert torch.equal(kept.detach(), torch.autograd.grad(loss, vertices)[0])
    with pytest.raises(NotImplementedError, match="first derivatives only"):
        kept.sum().backward()


def test_tensors_are_not_copied_and_strides_are_followed():
    poses, cameras, masks = scene(3)
    tensor = torch.tensor(VERTICES)
    assert operators._array(tensor).ctypes.data == tensor.data_ptr()
    faces, seen = torch.tensor(FACES), torch.tensor(masks)
    expected = losses.mask_iou_loss(tensor, faces, torch.tensor(poses), cameras, seen)
    spread = torch.tensor(np.repeat(VERTICES.T, 2, axis=1))[:, ::2].T
    flipped = torch.tensor(np.ascontiguousarray(masks.transpose(2, 0, 1))).permute(1, 2, 0)
    assert not spread.is_contiguous()
    assert not flipped.is_contiguous()
    found = losses.mask_iou_loss(spread.expand(3, -1, -1), faces.int(), torch.tensor(poses), cameras, flipped)
    assert torch.equal(found, expected)


def test_without_gradients_none_are_computed():
    with torch.no_grad():
        found = losses.mask_iou_loss(ARGUMENTS[0], EIGHT, ARGUMENTS[1], SMALL, MASKS)
    assert not found.requires_grad
    inputs = (ARGUMENTS[0], EIGHT, ARGUMENTS[1], torch.tensor(intrinsics_of(SMALL).values), MASKS)
    assert operators.mask_iou(*inputs, "exact", False, 1)[1].numel() == 0


def test_what_pytorch_can_ask_and_there_is_not_is_named():
    vertices, pose = ARGUMENTS
    with pytest.raises(GeometryError, match="no gradient over masks"):
        losses.mask_iou_loss(vertices, EIGHT, pose, SMALL, MASKS.clone().requires_grad_())
    with pytest.raises(GeometryError, match=r"vertices are on meta.*vertices.cpu\(\)"):
        losses.silhouettes(vertices.detach().to("meta"), EIGHT, pose, SMALL)
    with pytest.raises(GeometryError, match=r"float64 or float32, found torch.bfloat16"):
        losses.silhouettes(vertices.bfloat16(), EIGHT, pose.bfloat16(), SMALL)
    count = ASSOCIATION.shape[1]
    pixels, seen = torch.zeros((count, 2), requires_grad=True), torch.ones(count, dtype=torch.bool)
    with pytest.raises(GeometryError, match="no gradient over observed"):
        losses.keypoint_loss(torch.tensor(VERTICES), torch.tensor(ASSOCIATION), POSES, SMALL, pixels, seen)
