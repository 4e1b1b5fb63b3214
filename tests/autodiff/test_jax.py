"""What JAX alone asks of functions."""

import numpy as np
import pytest

jax = pytest.importorskip("jax", reason="the extra `jax` is not installed")
jax.config.update("jax_enable_x64", True)

from jax.test_util import check_grads  # noqa: E402

from meshslam.autodiff import jax as losses  # noqa: E402
from meshslam.geometry import Intrinsics, batched_mask_loss, batched_silhouettes, intrinsics_of  # noqa: E402
from tests.autodiff.frameworks import ASSOCIATION, CAMERA, FACES, VERTICES, scene  # noqa: E402


def test_check_grads():
    poses, cameras, masks = scene(2)
    pixels, visible = np.full((len(ASSOCIATION.T), 2), 20.0), np.arange(len(ASSOCIATION.T)) % 2 == 0
    for function in (
        lambda v, p: losses.mask_iou_loss(v, FACES, p, cameras, masks),
        lambda v, p: losses.silhouettes(v, FACES, p, cameras),
        lambda v, p: losses.keypoint_loss(v, ASSOCIATION, p, cameras, pixels, visible),
    ):
        check_grads(function, (VERTICES, poses), 1, modes=["rev"], eps=1e-6)


def test_vmap_over_everything_is_a_batch():
    poses, cameras, masks = scene(4)
    whole = batched_mask_loss(VERTICES, FACES, poses, cameras, masks)
    values = intrinsics_of(cameras).values

    def gradient(pose, intrinsics, mask):
        def loss(v):
            return losses.mask_iou_loss(v, FACES, pose, Intrinsics(intrinsics, 60, 40), mask)

        return jax.value_and_grad(loss)(VERTICES)

    value, found = jax.jit(jax.vmap(gradient))(poses, values, masks)
    np.testing.assert_array_equal(value, whole.losses)
    np.testing.assert_array_equal(found, whole.vertices)
    drawn = jax.vmap(lambda p, k: losses.silhouettes(VERTICES, FACES, p, Intrinsics(k, 60, 40)))(poses, values)
    np.testing.assert_array_equal(drawn, batched_silhouettes(VERTICES, FACES, poses, cameras))


def test_nested_vmap_over_objects_and_views():
    poses, _, masks = scene(3)
    objects = np.stack([VERTICES, 1.2 * VERTICES])
    one = losses.mask_iou_loss
    views = jax.vmap(lambda v, p, m: one(v, FACES, p, CAMERA, m), in_axes=(None, 0, 0))
    found = jax.jit(jax.vmap(views, in_axes=(0, None, None)))(objects, poses, masks)
    expected = batched_mask_loss(objects[:, None], FACES, poses, CAMERA, masks).losses
    np.testing.assert_array_equal(found, expected)
    # a batch within a mapped function keeps its place
    inner = jax.vmap(lambda v: one(v, FACES, poses, CAMERA, masks))(objects)
    np.testing.assert_array_equal(inner, expected)


def test_gradients_under_vmap_are_summed_over_what_is_shared():
    poses, _, _ = scene(3)
    objects = np.stack([VERTICES, 1.2 * VERTICES])

    def loss(pose):
        return jax.vmap(lambda v: losses.silhouettes(v, FACES, pose, CAMERA))(objects)[..., 5:30, :].sum()

    def looped(pose):
        return sum(losses.silhouettes(v, FACES, pose, CAMERA)[..., 5:30, :].sum() for v in objects)

    np.testing.assert_allclose(jax.grad(loss)(poses), jax.grad(looped)(poses), rtol=1e-12, atol=1e-12)


def test_faces_cannot_be_mapped():
    poses, _, _ = scene(1)
    with pytest.raises(Exception, match="vmap cannot map over them"):
        np.asarray(jax.vmap(lambda f: losses.silhouettes(VERTICES, f, poses[0], CAMERA))(np.stack([FACES] * 2)))


def test_forward_mode_is_refused():
    (pose,), _, (mask,) = scene(1)
    with pytest.raises(TypeError, match="forward-mode"):
        jax.jvp(lambda v: losses.mask_iou_loss(v, FACES, pose, CAMERA, mask), (VERTICES,), (VERTICES,))
    with pytest.raises(NotImplementedError, match="first derivatives only"):
        jax.hessian(lambda v: losses.mask_iou_loss(v, FACES, pose, CAMERA, mask))(VERTICES)


def test_large_pictures_pass_through():
    """A callback must not wait for the thread that it runs on."""
    (pose,), _, _ = scene(1)
    large = Intrinsics(np.array([700.0, 700.0, 600.0, 400.0, 0.0]), 1200, 800)
    total = jax.jit(lambda v: (losses.silhouettes(v, FACES, pose, large) * 2).sum())
    assert float(total(VERTICES)) == pytest.approx(2 * batched_silhouettes(VERTICES, FACES, pose, large).sum())
    assert np.isfinite(jax.jit(jax.grad(total))(VERTICES)).all()


def test_the_same_call_is_compiled_once():
    """Without `jit`, too: what JAX compiles, it keeps, with the arrays that it holds."""
    (pose,), _, (mask,) = scene(1)
    compiled = []
    jax.monitoring.register_event_duration_secs_listener(lambda name, *_, **__: compiled.append(name))

    def loss(v):
        iou = losses.mask_iou_loss(v, FACES, pose, CAMERA, mask)
        return iou + losses.silhouettes(v, FACES, pose, CAMERA).sum()

    def compilations(vertices):
        compiled.clear()
        jax.grad(loss)(vertices)
        return sum("backend_compile" in name for name in compiled)

    assert compilations(VERTICES * 1.01) > 0
    assert compilations(VERTICES * 1.02) == 0
    assert compilations(VERTICES * 1.03) == 0
