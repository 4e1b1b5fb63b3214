"""Hostile meshes and tensors: what must end in a clear error, or in finite numbers of the right shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.categories.spheres import icosphere
from meshslam.geometry import Camera

BALL = icosphere(1)
ODD = (0.0, -0.0, 0.1, 1e-300, -1e-12, 1e9, -1e12, 1e154, -1e300, np.nan, np.inf, -np.inf)


@dataclass(frozen=True, eq=False)
class Case:
    """Arguments of the losses, in NumPy's arrays."""

    vertices: np.ndarray
    faces: np.ndarray
    pose: np.ndarray
    camera: Camera | list[Camera]
    masks: np.ndarray
    association: np.ndarray
    pixels: np.ndarray
    visible: np.ndarray
    slopes: np.ndarray
    gradient: str


class Source:
    """Random choices, most of them sound."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def chance(self, one_in: int) -> bool:
        return bool(self.rng.integers(one_in) == 0)

    def numbers(self, shape, size: float) -> np.ndarray:
        """Numbers of a size; in some arrays a few that break things, or many on a grid."""
        out = self.rng.uniform(-size, size, shape)
        if self.chance(4):
            out = np.round(out * 2) / 2
        if out.size and self.chance(8):
            out.reshape(-1)[self.rng.integers(out.size, size=2)] = self.rng.choice(ODD, 2)
        return out

    def odd_shape(self, shape) -> tuple[int, ...]:
        """Sometimes one more or less than it should be, or a dimension more or less."""
        if not self.chance(25):
            return tuple(shape)
        changed = [max(0, n + int(self.rng.integers(-1, 2))) for n in shape]
        return tuple(changed[1:] if self.chance(3) else [1, *changed] if self.chance(3) else changed)

    def strided(self, array: np.ndarray) -> np.ndarray:
        """The same values in other strides or another type."""
        if array.ndim and self.chance(6):
            array = np.repeat(array, 2, axis=-1)[..., ::2]
        if array.ndim and self.chance(6):
            array = np.asfortranarray(array)
        if array.dtype == np.float64 and self.chance(6):
            with np.errstate(all="ignore"):
                return array.astype(self.rng.choice(["f4", "f2", "i8", "c16"]) if self.chance(4) else np.float32)
        return array

    def batch(self, leading) -> tuple[int, ...]:
        """A leading shape that goes with the batch."""
        cut = tuple(leading[int(self.rng.integers(len(leading) + 1)) :])
        return tuple(1 if self.chance(4) else n for n in cut)


def case(seed: int) -> Case:
    """The case of a seed."""
    source = Source(seed)
    rng = source.rng
    leading = [(), (0,), (1,), (2,), (3,), (2, 2), (2, 1, 2)][rng.integers(7)]
    count = int(rng.integers(0, 12)) if source.chance(2) else len(BALL.vertices)
    if count == len(BALL.vertices):
        vertices = BALL.vertices * rng.uniform(0.2, 3, 3) + source.numbers((*source.batch(leading), count, 3), 0.1)
        faces = BALL.faces
        if source.chance(4):
            faces = faces[rng.random(len(faces)) < 0.7]
    else:
        vertices = source.numbers((*source.batch(leading), count, 3), 2.0)
        faces = rng.integers(0, max(count, 1), (int(rng.integers(0, 20)) * (count > 0), 3))
    if faces.size and source.chance(25):
        faces = faces.copy()
        faces.reshape(-1)[rng.integers(faces.size)] = rng.choice([-1, count, 2**40])
    pose = np.broadcast_to(np.eye(4), (*source.batch(leading), 4, 4)).copy()
    pose[..., :3, :3] = np.linalg.qr(rng.normal(size=pose.shape[:-2] + (3, 3)))[0]
    pose[..., :3, 3] = source.numbers(pose.shape[:-2] + (3,), 1.0) + [0, 0, rng.uniform(-1, 6)]
    if source.chance(10):
        pose = source.numbers(pose.shape, 2.0)
    width, height = (int(n) for n in rng.integers(1, 40, 2))
    cameras = [
        Camera(width, height, *np.abs(rng.uniform(0.1, 60, 2)), *rng.uniform(-9, 40, 2), rng.uniform(-3, 3))
        for _ in range(leading[-1] if leading and source.chance(3) else 1)
    ]
    masks = rng.random(source.odd_shape((*source.batch(leading), height, width)))
    masks = [masks < 0.5, (masks < 0.5).astype(np.uint8) * 255, masks, (masks < 0.5) * 1.0][rng.integers(4)]
    if masks.dtype == float and masks.size and source.chance(10):
        masks.reshape(-1)[0] = rng.choice(ODD)
    points = int(rng.integers(0, 5))
    before = source.batch(leading)
    return Case(
        vertices=source.strided(vertices if not source.chance(25) else vertices[..., :2]),
        faces=source.strided(faces.astype(rng.choice(["i8", "i4", "u1"]) if source.chance(8) else "i8")),
        pose=source.strided(pose),
        camera=cameras if len(cameras) != 1 or source.chance(2) else cameras[0],
        masks=source.strided(masks),
        association=source.numbers(source.odd_shape((count, points)), 1.0),
        pixels=source.numbers(source.odd_shape((*before, points, 2)), 30.0),
        visible=rng.random(source.odd_shape((*before, points))) < 0.7,
        slopes=source.strided(source.numbers(source.odd_shape((*leading, height, width)), 1.0)),
        gradient=str(rng.choice(["exact", "exact", "kato", "none"])) if source.chance(3) else "exact",
    )
