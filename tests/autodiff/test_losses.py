"""The same battery over both frameworks: what they give is what the core gives, and its central differences."""

import numpy as np
import pytest

from meshslam.errors import GeometryError
from meshslam.geometry import (
    Camera,
    Pose,
    batched_keypoint_loss,
    batched_mask_loss,
    batched_silhouettes,
    intrinsics_of,
)
from tests.autodiff.frameworks import ASSOCIATION, CAMERA, FACES, FRAMEWORKS, VERTICES, scene


@pytest.fixture(scope="module", params=FRAMEWORKS)
def framework(request):
    return FRAMEWORKS[request.param]()


@pytest.fixture(scope="module")
def keypoints():
    rng = np.random.default_rng(2)
    count = ASSOCIATION.shape[1]
    pixels, visible = rng.normal(25, 10, size=(4, count, 2)), rng.random((4, count)) < 0.7
    pixels[~visible] = np.nan
    return pixels, visible


def central(function, values, direction, step=1e-6):
    def moved(by):
        return float(function(*(v + by * d for v, d in zip(values, direction, strict=True))))

    return (moved(step) - moved(-step)) / (2 * step)


@pytest.mark.parametrize("name", ["mask_iou_loss", "silhouettes", "keypoint_loss"])
def test_gradients_are_central_differences(framework, keypoints, name, rng):
    poses, cameras, masks = scene(4)
    weights = rng.normal(size=(4, CAMERA.height, CAMERA.width) if name == "silhouettes" else 4)
    a = framework.array
    rest = {
        "mask_iou_loss": (a(FACES), a(masks)),
        "silhouettes": (a(FACES),),
        "keypoint_loss": (a(ASSOCIATION), *map(a, keypoints)),
    }[name]

    def scalar(vertices, pose):
        first, *seen = rest
        return (a(weights) * getattr(framework.losses, name)(a(vertices), first, a(pose), cameras, *seen)).sum()

    found = framework.gradients(scalar, VERTICES, poses)
    assert [g.shape for g in found] == [VERTICES.shape, poses.shape]
    for _ in range(5):
        direction = rng.normal(size=VERTICES.shape), rng.normal(size=poses.shape)  # the last rows, too: they do nothing
        numeric = central(scalar, (VERTICES, poses), direction)
        assert sum((g * d).sum() for g, d in zip(found, direction, strict=True)) == pytest.approx(numeric, rel=1e-5)


def test_the_values_are_the_cores_to_the_last_bit(framework, keypoints):
    poses, cameras, masks = scene(4)
    a = framework.array
    for gradient in ("exact", "kato"):
        found = framework.losses.mask_iou_loss(a(VERTICES), a(FACES), a(poses), cameras, a(masks), gradient=gradient)
        expected = batched_mask_loss(VERTICES, FACES, poses, cameras, masks, gradient=gradient)
        np.testing.assert_array_equal(np.asarray(found), expected.losses)

        def scalar(v, g=gradient):
            return framework.losses.mask_iou_loss(v, a(FACES), a(poses[1]), cameras[1], a(masks[1]), gradient=g).sum()

        np.testing.assert_array_equal(framework.gradients(scalar, VERTICES)[0], expected.vertices[1])
    drawn = framework.losses.silhouettes(a(VERTICES), a(FACES), a(poses), cameras)
    np.testing.assert_array_equal(np.asarray(drawn), batched_silhouettes(VERTICES, FACES, poses, cameras))
    found = framework.losses.keypoint_loss(a(VERTICES), a(ASSOCIATION), a(poses), cameras, *map(a, keypoints))
    expected = batched_keypoint_loss(VERTICES, ASSOCIATION, poses, cameras, *keypoints)
    np.testing.assert_array_equal(np.asarray(found), expected.losses)


def test_a_batch_of_objects_and_views_is_a_loop_over_them(framework, rng):
    poses, cameras, masks = scene(3)
    objects, weights = np.stack([VERTICES, 1.2 * VERTICES])[:, None], rng.normal(size=(2, 3))
    a, loss = framework.array, framework.losses.mask_iou_loss

    def whole(v, p):
        return (a(weights) * loss(v, a(FACES), p, cameras, a(masks))).sum()

    of_vertices, of_poses = framework.gradients(whole, objects, poses)
    summed = np.zeros_like(VERTICES)
    for k in range(3):

        def one(v, p, k=k):
            return a(weights[1, k]) * loss(v, a(FACES), p, cameras[k], a(masks[k])).sum()

        alone = framework.gradients(one, objects[1, 0], poses[k])
        summed += alone[0]
    np.testing.assert_allclose(of_vertices[1, 0], summed, rtol=1e-13, atol=1e-15)

    def first(v, p, k=2):
        return sum(a(weights[i, k]) * loss(v[i, 0], a(FACES), p, cameras[k], a(masks[k])).sum() for i in range(2))

    np.testing.assert_allclose(of_poses[2], framework.gradients(first, objects, poses[2])[1], rtol=1e-13, atol=1e-15)


def test_per_view_gradients_are_the_same_bits_in_a_batch_alone_and_on_any_number_of_threads(framework):
    poses, cameras, masks = scene(5)
    each, a = np.repeat(VERTICES[None], 5, axis=0), framework.array

    def gradients(threads, k=slice(None)):
        def scalar(v, p):
            options = {"threads": threads}
            return framework.losses.mask_iou_loss(v, a(FACES), p, cameras[k], a(masks[k]), **options).sum()

        return framework.gradients(scalar, each[k], poses[k])

    whole = gradients(1)
    for threads in (0, 2, 3):
        for found, expected in zip(gradients(threads), whole, strict=True):
            np.testing.assert_array_equal(found, expected)
    for k in range(5):
        for found, expected in zip(gradients(1, k), whole, strict=True):
            np.testing.assert_array_equal(found, expected[k])


@pytest.mark.filterwarnings("ignore:.*torch.*:FutureWarning")  # PyTorch's own
def test_it_compiles(framework):
    poses, cameras, masks = scene(3)
    a, intrinsics = framework.array, intrinsics_of(cameras)

    def scalar(vertices, pose):
        iou = framework.losses.mask_iou_loss(vertices, a(FACES), pose, intrinsics, a(masks))
        return iou.sum() + framework.losses.silhouettes(vertices, a(FACES), pose, intrinsics).sum() * 1e-3

    fast = framework.gradients(framework.compiled(scalar), VERTICES, poses)
    for found, expected in zip(fast, framework.gradients(scalar, VERTICES, poses), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14)


def test_second_derivatives_are_refused(framework):
    poses, cameras, masks = scene(2)
    a = framework.array

    def loss(v):
        return (framework.losses.mask_iou_loss(v, a(FACES), a(poses), cameras, a(masks)) ** 2).sum()

    def drawn(v):
        return (framework.losses.silhouettes(v, a(FACES), a(poses), cameras) ** 2).sum()

    for function in (loss, drawn):
        if hasattr(framework, "jax"):
            twice = framework.jax.grad(lambda v, f=function: (framework.jax.grad(f)(v) ** 2).sum())
        else:

            def twice(v, f=function):
                grad = framework.torch.autograd.grad
                v = v.clone().requires_grad_()
                return grad((grad(f(v), v, create_graph=True)[0] ** 2).sum(), v)

        with pytest.raises(NotImplementedError, match="first derivatives only"):
            twice(a(VERTICES))


def test_single_precision_stays_single(framework):
    poses, cameras, masks = scene(2)
    a, v, p = framework.array, VERTICES.astype(np.float32), poses.astype(np.float32)

    def scalar(v, p):
        return framework.losses.mask_iou_loss(v, a(FACES.astype(np.int32)), p, cameras, a(masks)).sum()

    exact = framework.gradients(scalar, VERTICES, poses)
    for found, expected in zip(framework.gradients(scalar, v, p), exact, strict=True):
        assert found.dtype == np.float32
        np.testing.assert_allclose(found, expected, atol=1e-3)
    assert framework.losses.silhouettes(a(v), a(FACES), a(p), cameras).dtype == a(v).dtype


def test_nothing_in_gives_nothing_out(framework):
    a = framework.array
    none = (a(np.zeros((0, 4, 4))), CAMERA, a(np.zeros((0, 40, 60), bool)))
    assert framework.losses.mask_iou_loss(a(VERTICES), a(FACES), *none).shape == (0,)
    assert framework.losses.silhouettes(a(VERTICES), a(FACES), *none[:2]).shape == (0, 40, 60)

    def scalar(v, p):
        return framework.losses.mask_iou_loss(v, a(FACES), p, CAMERA, none[2]).sum()

    of_vertices, of_poses = framework.gradients(scalar, VERTICES, np.zeros((0, 4, 4)))
    assert not of_vertices.any()
    assert of_poses.shape == (0, 4, 4)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"vertices": np.full_like(VERTICES, np.nan)}, "vertices must be finite"),
        ({"vertices": VERTICES[:, :2]}, "vertices must have shape"),
        ({"faces": FACES + 1}, "names vertex 42"),
        ({"faces": FACES[:, :2]}, "must have shape"),
        ({"camera_from_object": np.full((4, 4), np.inf)}, "camera_from_object must be finite"),
        ({"camera_from_object": np.eye(3)}, "camera_from_object"),
        ({"masks": np.zeros((39, 60), bool)}, "masks"),
        ({"masks": np.full((40, 60), 2.0)}, "from 0 to 1"),
        ({"camera": [CAMERA, Camera(9, 9, 9, 9, 9, 9)]}, "images of one size"),
        ({"gradient": "soft"}, "'exact' or 'kato'"),
        ({"camera_from_object": np.stack([np.eye(4)] * 2), "masks": np.zeros((3, 40, 60), bool)}, "do not go together"),
    ],
)
def test_what_cannot_be_used_is_named(framework, change, words):
    (pose,), _, (mask,) = scene(1)
    given = {"vertices": VERTICES, "faces": FACES, "camera_from_object": pose, "camera": CAMERA, "masks": mask} | change
    given = {k: framework.array(v) if isinstance(v, np.ndarray) else v for k, v in given.items()}
    with pytest.raises(Exception, match=words) as found:
        np.asarray(framework.losses.mask_iou_loss(**given))
    assert isinstance(found.value, GeometryError) or type(found.value).__name__ == "JaxRuntimeError"


def test_the_exponential_is_that_of_poses(framework, rng):
    tangents = rng.normal(size=(2, 3, 6))
    found = np.asarray(framework.losses.exp_se3(framework.array(tangents)))
    for index in np.ndindex(2, 3):
        np.testing.assert_allclose(found[index], Pose.exp(tangents[index]).matrix, atol=1e-12)
    at_zero = framework.gradients(lambda x: framework.losses.exp_se3(x)[0, 1], np.zeros(6))[0]
    np.testing.assert_allclose(at_zero, [0, 0, 0, 0, 0, -1], atol=1e-12)


def test_adam_finds_a_pose(framework):
    """A descent over a tangent vector, as docs and examples have it."""
    (start,), _, _ = scene(1)
    step = np.array([0.1, -0.05, 0.1, 0.1, -0.1, 0.05])
    truth = start @ Pose.exp(step).matrix
    mask, a = batched_silhouettes(VERTICES, FACES, truth, CAMERA), framework.array

    def loss(tangent):
        pose = a(start) @ framework.losses.exp_se3(tangent)
        return framework.losses.mask_iou_loss(a(VERTICES), a(FACES), pose, CAMERA, a(mask)).sum()

    x, m, v = np.zeros(6), np.zeros(6), np.zeros(6)
    for k in range(1, 61):
        (g,) = framework.gradients(loss, x)
        m, v = 0.9 * m + 0.1 * g, 0.999 * v + 0.001 * g * g
        x = x - 0.01 * (m / (1 - 0.9**k)) / (np.sqrt(v / (1 - 0.999**k)) + 1e-8)
    best = float(loss(a(step)))  # not -1: shares between 0 and 1 do not cover themselves
    assert float(loss(a(np.zeros(6)))) > best + 0.1
    assert float(loss(a(x))) < best + 0.005
