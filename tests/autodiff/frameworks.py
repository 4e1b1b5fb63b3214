"""The two frameworks behind one face, so that the same battery runs over both; and a small scene."""

from __future__ import annotations

import numpy as np
import pytest

from meshslam.categories.spheres import icosphere
from meshslam.geometry import Camera, Pose, batched_silhouettes, exp_so3

CAMERA = Camera(60, 40, 50.0, 51.0, 29.0, 20.0, 0.4)
BALL = icosphere(1)
VERTICES = BALL.vertices * np.array([1.0, 0.6, 0.5])
FACES = BALL.faces
ASSOCIATION = np.eye(len(VERTICES))[:, ::6] * 0.7 + np.eye(len(VERTICES))[:, 1::6][:, :7] * 0.3


def scene(views, seed=0):
    """Poses (n, 4, 4), cameras, masks (n, h, w) of a ball a little larger and farther to the side."""
    rng = np.random.default_rng(seed)
    poses = [
        Pose(exp_so3(rng.normal(size=3)), np.array([*rng.uniform(-0.5, 0.5, 2), 3.0 + k % 4])) for k in range(views)
    ]
    cameras = [Camera(60, 40, 50.0 + k, 51.0, 29.0 - 0.5 * k, 20.0, 0.4) for k in range(views)]
    matrices = np.stack([pose.matrix for pose in poses]) if views else np.zeros((0, 4, 4))
    masks = [
        batched_silhouettes(1.1 * VERTICES + 0.1, FACES, m, c) > 0.5 for m, c in zip(matrices, cameras, strict=True)
    ]
    return matrices, cameras, np.array(masks, bool).reshape(views, 40, 60)


class Jax:
    """JAX in double precision."""

    def __init__(self):
        jax = pytest.importorskip("jax", reason="the extra `jax` is not installed")
        jax.config.update("jax_enable_x64", True)
        from meshslam.autodiff import jax as losses

        self.jax, self.losses = jax, losses

    def array(self, values):
        return self.jax.numpy.asarray(values)

    def compiled(self, function):
        return self.jax.jit(function)

    def gradients(self, function, *values):
        """Gradients of a scalar function."""
        found = self.jax.grad(function, argnums=tuple(range(len(values))))(*map(self.array, values))
        return [np.asarray(g) for g in found]


class Torch:
    """PyTorch in double precision."""

    def __init__(self):
        torch = pytest.importorskip("torch", reason="the extra `torch` is not installed: make test-torch")
        from meshslam.autodiff import torch as losses

        self.torch, self.losses = torch, losses

    def array(self, values):
        return values if isinstance(values, self.torch.Tensor) else self.torch.as_tensor(np.asarray(values))

    def compiled(self, function):
        return self.torch.compile(function, fullgraph=True)

    def gradients(self, function, *values):
        """Gradients of a scalar function."""
        leaves = [self.array(v).clone().requires_grad_() for v in values]
        return [g.numpy() for g in self.torch.autograd.grad(function(*leaves), leaves)]


FRAMEWORKS = {"jax": Jax, "torch": Torch}
