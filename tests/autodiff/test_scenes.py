"""Objects that hide each other: against a finely sampled z-buffer, and central differences."""

import numpy as np
import pytest

from meshslam.errors import GeometryError
from meshslam.geometry import Camera, Pose, exp_so3, mask_loss, occlusion_order, render
from tests.autodiff.frameworks import CAMERA, FACES, FRAMEWORKS, VERTICES
from tests.reference import area_iou

TURN = exp_so3(np.array([0.3, 0.4, 0.5]))
POSES = [Pose(TURN, np.array(t)) for t in ([0.0, 0.0, 4.0], [0.5, 0.3, 3.0], [-0.4, 0.2, 6.0])]
SQUARE = (np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))


@pytest.fixture(scope="module", params=FRAMEWORKS)
def framework(request):
    return FRAMEWORKS[request.param]()


def meshes_of(framework, vertices=(VERTICES,) * 3, poses=POSES):
    a = framework.array
    return [(a(v), a(FACES), a(getattr(pose, "matrix", pose))) for v, pose in zip(vertices, poses, strict=True)]


def test_shares_are_those_of_a_fine_z_buffer(framework):
    fine = render(area_iou.finer(CAMERA, 20), [(pose, VERTICES, FACES) for pose in POSES]).object_index
    found = np.asarray(framework.losses.scene_silhouettes(meshes_of(framework), CAMERA))
    for number in range(3):
        twin = (fine == number).reshape(40, 20, 60, 20).mean((1, 3))
        assert np.abs(found[number] - twin).max() < 0.06
        assert abs(found[number].sum() - twin.sum()) < 0.05
    alone = framework.losses.silhouettes(
        framework.array(VERTICES), framework.array(FACES), framework.array(POSES[0].matrix), CAMERA
    )
    assert np.asarray(alone).sum() > found[0].sum() + 20  # it is hidden in part


def test_gradients_are_central_differences(framework, rng):
    a, weights = framework.array, rng.normal(size=(3, 40, 60))
    matrices = [pose.matrix for pose in POSES]

    def scalar(first, second, pose):
        meshes = meshes_of(framework, (first, second, VERTICES), [matrices[0], pose, matrices[2]])
        return (framework.losses.scene_silhouettes(meshes, CAMERA) * a(weights)).sum()

    values = (VERTICES, 1.1 * VERTICES, matrices[1])
    found = framework.gradients(scalar, *values)
    assert all(np.abs(g).max() > 0.1 for g in found)
    for _ in range(3):
        direction = [rng.normal(size=v.shape) for v in values]
        ends = [float(scalar(*(a(v + s * 1e-6 * d) for v, d in zip(values, direction, strict=True)))) for s in (1, -1)]
        numeric = (ends[0] - ends[1]) / 2e-6
        assert sum((g * d).sum() for g, d in zip(found, direction, strict=True)) == pytest.approx(numeric, rel=1e-5)


def test_views_may_order_objects_differently(framework):
    a = framework.array
    front = np.stack([POSES[0].matrix, POSES[1].matrix])
    back = np.stack([POSES[1].matrix, POSES[0].matrix])
    meshes = [(a(VERTICES), a(FACES), a(front)), (a(VERTICES), a(FACES), a(back))]
    both = np.asarray(framework.losses.scene_silhouettes(meshes, [CAMERA, CAMERA]))
    assert both.shape == (2, 2, 40, 60)
    np.testing.assert_allclose(both[0], both[1, ::-1], atol=1e-12)


def test_masks_with_occlusion(framework):
    masks = np.stack([render(CAMERA, [(p, 1.05 * VERTICES, FACES) for p in POSES]).object_index == k for k in range(3)])
    a = framework.array
    shares = np.asarray(framework.losses.scene_silhouettes(meshes_of(framework), CAMERA))
    for values in (masks, masks.astype(np.uint8) * 255, masks.astype(float)):
        found = framework.losses.scene_mask_iou_loss(meshes_of(framework), CAMERA, a(values))
        np.testing.assert_allclose(np.asarray(found), mask_loss(masks.astype(float), shares), rtol=1e-12)
    whole = framework.losses.silhouettes(a(VERTICES), a(FACES), a(POSES[0].matrix), CAMERA)
    assert found[0] < mask_loss(masks[0].astype(float), np.asarray(whole)) - 0.1  # what hides it is taken into account


def test_one_object_is_a_silhouette(framework):
    a = framework.array
    one = framework.losses.scene_silhouettes(meshes_of(framework)[:1], CAMERA)
    alone = framework.losses.silhouettes(a(VERTICES), a(FACES), a(POSES[0].matrix), CAMERA)
    np.testing.assert_allclose(np.asarray(one)[0], np.asarray(alone), atol=1e-12)


@pytest.mark.filterwarnings("ignore:.*torch.*:FutureWarning")  # PyTorch's own
def test_it_compiles(framework):
    def scalar(vertices):
        meshes = meshes_of(framework, (vertices, VERTICES, VERTICES))
        return framework.losses.scene_silhouettes(meshes, CAMERA)[0].sum()

    (fast,), (slow,) = (framework.gradients(f, VERTICES) for f in (framework.compiled(scalar), scalar))
    np.testing.assert_allclose(fast, slow, atol=1e-10)


def test_the_order_is_that_of_most_common_pixels():
    camera, (square, faces) = Camera(64, 64, 64.0, 64.0, 31.5, 31.5), SQUARE
    near, far = square + [0, 0, 3.0], square * 3 + [0, 0, 5.0]
    leaning = square @ exp_so3(np.array([0.0, 1.2, 0.0])).T + [0.3, 0, 3.0]  # most of it is behind `near`
    points = np.concatenate([far, near, leaning])
    joined = np.concatenate([faces, faces + 4, faces + 8])
    order = occlusion_order(points, joined, (2, 2, 2), camera)
    assert order[0, 1] and not order[1, 0]  # noqa: PT018 # one order
    assert order[0, 2] and not order[2, 0]  # noqa: PT018
    assert order[1, 2] != order[2, 1]
    assert not order.diagonal().any()
    apart = occlusion_order(np.concatenate([far + [90, 0, 0], near]), joined[:4], (2, 2), camera)
    assert apart[0, 1] and not apart[1, 0]  # noqa: PT018 # no common pixel: the nearer one
    with pytest.raises(GeometryError, match="add up to 3"):
        occlusion_order(points, joined, (1, 2), camera)
