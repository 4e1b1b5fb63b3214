"""What roads and house fronts look like, as functions of where a point lies on them: BGR from 0 to 1."""

from __future__ import annotations

import cv2
import numpy as np

from meshslam.geometry import Floats
from meshslam.simulation.fronts import Wall

_TILE = 256  # cells of the noise in each direction before it repeats
_ROW = 1024


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


def ground(along: Floats, aside: Floats, kerb_m: float, pixel_m: Floats, noise: Noise) -> Floats:
    """Asphalt with patches and a broken middle line, a kerb, pavements of slabs; (n, 3) at metres along and aside."""
    grain = noise.grain(along, aside, pixel_m)
    colour = (0.20 + 0.045 * grain)[:, None] * np.ones(3)
    colour[noise(along, aside, 3.1) > 0.55] *= 0.8
    line = (np.abs(aside) < 0.07) & (np.mod(along, 6.0) < 3.0)
    colour[line] = 0.65
    out = np.abs(aside) - kerb_m
    joint = (np.mod(along, 0.8) < 0.04) | (np.mod(out, 0.8) < 0.04)
    slabs = 0.34 + 0.035 * grain + 0.05 * noise(np.floor(along / 0.8) * 7.3, np.floor(aside / 0.8) * 7.3, 1.0)
    slabs = np.where(joint & (pixel_m < 0.08), 0.22, slabs)
    colour[out > 0] = slabs[out > 0][:, None]
    colour[(out > 0) & (out < 0.15)] = 0.42
    return colour


def wall(front: Wall, points_in_world: Floats, pixel_m: Floats, noise: Noise) -> Floats:
    """Plaster with rows of windows and a plinth; points (n, 3)."""
    along = (front.end - front.start)[:2]
    width = float(np.linalg.norm(along))
    u = (points_in_world[:, :2] - front.start[:2]) @ (along / width)
    v = points_in_world[:, 2] - front.start[2]
    grain = noise.grain(u + 31.0 * front.start[0], v, pixel_m)
    colour = front.colour_bgr * (0.75 + 0.09 * grain)[:, None]
    columns = max(1, round(width / 2.6))
    in_column, in_storey = np.mod(u * columns / width, 1.0), np.mod(v - 0.9, 3.0)
    frame = (np.abs(in_column - 0.5) < 0.24) & (in_storey > 0.25) & (in_storey < 1.95) & (v > 0.9)
    glass = (np.abs(in_column - 0.5) < 0.20) & (in_storey > 0.37) & (in_storey < 1.83) & (v > 0.9)
    bar = np.abs(in_column - 0.5) < 0.02
    colour[frame] = 0.7
    colour[glass & ~bar] = [0.22, 0.18, 0.15]
    colour[v < 0.6] *= 0.7
    return colour
