"""What surfaces look like, as functions of where a point lies on them: BGR from 0 to 1."""

from __future__ import annotations

import cv2
import numpy as np

from meshslam.geometry.arrays import Bools, Floats
from meshslam.simulation.street import Car, Wall

SUN = np.array([0.35, -0.5, 0.79]) / np.linalg.norm([0.35, -0.5, 0.79])  # towards the sun, in world
AMBIENT = 0.5
_TILE = 256  # cells of the noise in each direction before it repeats
_ROW = 1024
_WHEEL_RADIUS_M = 0.32
_RIM_RADIUS_M = 0.19
_BELT, _ROOF = 0.60, 0.93  # heights of the glass's edges over the car's


class Noise:
    """Values from -1 to 1 on a plane, smooth between the points of a grid of random values."""

    def __init__(self, seed: int) -> None:
        self._tile = np.random.default_rng(seed).uniform(-1.0, 1.0, (_TILE, _TILE)).astype(np.float32)

    def __call__(self, x: Floats, y: Floats, cell_m: float) -> Floats:
        """Values at x, y (any shape) in metres, on a grid of `cell_m`."""
        places = np.zeros((2, -(-x.size // _ROW), _ROW), np.float32)  # remap takes pictures of fewer than 32768 rows
        for place, metres in zip(places, (x, y), strict=True):
            place.reshape(-1)[: x.size] = np.mod(metres / cell_m, _TILE).ravel()
        values = cv2.remap(self._tile, places[0], places[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        return np.asarray(values, float).reshape(-1)[: x.size].reshape(x.shape)

    def grain(self, x: Floats, y: Floats, pixel_m: Floats) -> Floats:
        """Several grids together; those finer than a pixel's size on the surface fade away."""
        total = np.zeros(x.shape)
        for cell_m, share in ((0.05, 0.35), (0.17, 0.5), (0.6, 0.6), (2.3, 0.5)):
            total += share * np.clip(cell_m / pixel_m - 0.5, 0.0, 1.0) * self(x, y, cell_m)
        return total


def shaded(colour: Floats, normals_in_world: Floats, lit: Bools | None = None) -> Floats:
    """Lambert's law under sun and sky; `lit` tells where the sun shines."""
    sun = np.maximum(normals_in_world @ SUN, 0.0)
    light = AMBIENT + (1.0 - AMBIENT) * (sun if lit is None else sun * lit)
    lighted: Floats = colour * light[..., None]
    return lighted


def sky(rays_in_world: Floats) -> Floats:
    """From pale at the horizon to blue above; rays (..., 3)."""
    height = np.clip(rays_in_world[..., 2] / np.linalg.norm(rays_in_world, axis=-1), 0.0, 1.0)[..., None]
    pale, blue = np.array([0.95, 0.92, 0.88]), np.array([0.85, 0.62, 0.42])
    colour: Floats = pale + (blue - pale) * np.sqrt(height)
    return colour


def ground(points_in_world: Floats, kerb_m: float, pixel_m: Floats, noise: Noise) -> Floats:
    """Asphalt with patches and a broken middle line, a kerb, pavements of slabs; points (..., 3)."""
    x, y = points_in_world[..., 0], points_in_world[..., 1]
    grain = noise.grain(x, y, pixel_m)
    colour = (0.36 + 0.07 * grain)[..., None] * np.ones(3)
    patch = noise(x, y, 3.1) > 0.55
    colour[patch] *= 0.8
    line = (np.abs(y) < 0.07) & (np.mod(x, 6.0) < 3.0)
    colour[line] = 0.85
    pavement = np.abs(y) > kerb_m
    joint = (np.mod(x, 0.8) < 0.04) | (np.mod(np.abs(y) - kerb_m, 0.8) < 0.04)
    slabs = 0.55 + 0.05 * grain + 0.06 * noise(np.floor(x / 0.8) * 7.3, np.floor(y / 0.8) * 7.3, 1.0)
    slabs = np.where(joint & (pixel_m < 0.08), 0.4, slabs)
    colour[pavement] = slabs[pavement][:, None]
    kerb = (np.abs(y) > kerb_m) & (np.abs(y) < kerb_m + 0.15)
    colour[kerb] = 0.68
    return colour


def wall(front: Wall, points_in_world: Floats, pixel_m: Floats, noise: Noise) -> Floats:
    """Plaster with rows of windows and a plinth; points (n, 3)."""
    along = front.end - front.start
    width = float(np.linalg.norm(along))
    u = (points_in_world[:, :2] - front.start) @ (along / width)
    v = points_in_world[:, 2]
    grain = noise.grain(u + 31.0 * front.start[0], v, pixel_m)
    colour = front.colour_bgr * (1.0 + 0.12 * grain)[:, None]
    columns = max(1, round(width / 2.6))
    in_column, in_storey = np.mod(u * columns / width, 1.0), np.mod(v - 0.9, 3.0)
    frame = (np.abs(in_column - 0.5) < 0.24) & (in_storey > 0.25) & (in_storey < 1.95) & (v > 0.9)
    glass = (np.abs(in_column - 0.5) < 0.20) & (in_storey > 0.37) & (in_storey < 1.83) & (v > 0.9)
    bar = np.abs(in_column - 0.5) < 0.02
    colour[frame] = 0.85
    colour[glass & ~bar] = [0.34, 0.28, 0.24]
    colour[v < 0.6] *= 0.7
    return colour


def car(body: Car, points_in_object: Floats, normals_in_object: Floats) -> Floats:
    """Paint, glass, tyres and lights; points and normals (n, 3) in the object's frame."""
    low, high = body.vertices.min(0), body.vertices.max(0)
    x, y, height = points_in_object[:, 0], points_in_object[:, 1], points_in_object[:, 2] - low[2]
    share = height / (high[2] - low[2])
    colour = np.tile(body.colour_bgr, (len(x), 1))
    colour[share < 0.22] = 0.12  # sills and bumpers' lower edges
    glass = (share > _BELT) & (share < _ROOF) & (normals_in_object[:, 2] < 0.88)
    colour[glass] = [0.20, 0.16, 0.13]
    for name, point in body.keypoints.items():
        gap = points_in_object - point
        if "light" in name or "trunk" in name:
            near = (np.abs(gap[:, 1]) < 0.17) & (np.abs(gap[:, 2]) < 0.08) & (np.abs(gap[:, 0]) < 0.5)
            colour[near & ~glass] = [0.95, 0.97, 1.0] if "light" in name else [0.10, 0.08, 0.70]
        if "wheel" in name:
            away = np.hypot(x - point[0], height - _WHEEL_RADIUS_M)
            side = (np.sign(y) == np.sign(point[1])) & (np.abs(y) > 0.6 * high[1])
            colour[side & (away < _WHEEL_RADIUS_M)] = 0.06
            colour[side & (away < _RIM_RADIUS_M)] = 0.55
    return colour
