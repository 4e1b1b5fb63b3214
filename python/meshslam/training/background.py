"""What is around the cars of a training picture: texture of the road, fronts, trees, fences, sky."""

from __future__ import annotations

import cv2
import numpy as np

from meshslam.geometry import Camera, Floats
from meshslam.simulation import Light

_TILE = 128
_ROW = 4096


def ground_texture(rng: np.random.Generator, x: Floats, y: Floats, pixel_m: Floats) -> Floats:
    """Brightness (n,) about 1 of road points, metres: grain, patches, joints, lines."""
    bright = np.ones(len(x))
    if not len(x):
        return bright
    for cell_m, share in ((0.08, 0.15), (0.4, 0.18), (1.7, 0.2), (6.0, 0.25)):
        tile = rng.uniform(-1, 1, (_TILE, _TILE)).astype(np.float32)
        bright += share * rng.uniform(0, 1) * np.clip(cell_m / pixel_m - 0.5, 0, 1) * _sampled(tile, x, y, cell_m)
    turn = rng.uniform(-0.2, 0.2)
    across = y * np.cos(turn) + x * np.sin(turn)
    if rng.random() < 0.5:
        kerb = rng.uniform(-6, 6)
        bright[across > kerb] *= rng.uniform(0.6, 1.6)
        bright[np.abs(across - kerb) < 0.08] *= rng.uniform(0.6, 1.8)
    if rng.random() < 0.4:
        bright[np.abs(across - rng.uniform(-6, 6)) < 0.06] = rng.uniform(1.5, 3.0)
    return np.clip(bright, 0.2, 3.0)


def _sampled(tile: np.ndarray, x: Floats, y: Floats, cell_m: float) -> Floats:
    places = np.zeros((2, -(-x.size // _ROW), _ROW), np.float32)
    for place, metres in zip(places, (x, y), strict=True):
        place.reshape(-1)[: x.size] = np.mod(metres / cell_m, _TILE)
    values = cv2.remap(tile, places[0], places[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return np.asarray(values, float).reshape(-1)[: x.size]


def clouded(rng: np.random.Generator, height: int, width: int, cells: int) -> Floats:
    """Smooth noise (h, w) from -1 to 1 with about `cells` cells across."""
    small = rng.uniform(-1, 1, (max(2, cells * height // max(width, 1) + 1), cells + 1)).astype(np.float32)
    return np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC), float)


def _colour(rng: np.random.Generator) -> Floats:
    grey = rng.uniform(0.03, 0.95)
    return np.clip(grey + rng.normal(0, 0.07, 3), 0.0, 1.0)


def backdrop(rng: np.random.Generator, camera: Camera, light: Light) -> Floats:
    """A picture (h, w, 3) of what stands behind the cars."""
    height, width = camera.height, camera.width
    strength = min(1.0, light.ambient + 0.5 * light.sun_strength)
    colour = np.tile(_colour(rng) * strength, (height, width, 1))
    if rng.random() < 0.3:
        rise = np.linspace(1, 0, height)[:, None, None]
        colour = light.sky_low * (1 - rise) + light.sky_high * rise + np.zeros((height, width, 1))
    for _ in range(int(rng.integers(0, 4))):
        _front(rng, colour, strength)
    if rng.random() < 0.6:
        _trees(rng, colour, strength)
    for _ in range(int(rng.integers(0, 6))):
        _bar(rng, colour, strength)
    grain = clouded(rng, height, width, int(rng.integers(4, 60))) * rng.uniform(0, 0.25)
    grown: Floats = np.clip(colour * (1 + grain[..., None]), 0, 1.2)
    return grown


def _front(rng: np.random.Generator, colour: Floats, strength: float) -> None:
    """A wall with rows of windows."""
    height, width = colour.shape[:2]
    x0, x1 = sorted(rng.integers(-width // 2, width + width // 2, 2).tolist())
    top = int(rng.integers(-height, height))
    cv2.rectangle(colour, (x0, top), (x1, height), _tuple(_colour(rng) * strength), cv2.FILLED)
    step_x, step_y = (int(v) for v in rng.uniform(0.08, 0.5, 2) * width + 4)
    pane = _tuple(_colour(rng) * strength * 0.6)
    share = rng.uniform(0.3, 0.75, 2)
    for x in range(x0 + step_x // 4, x1 - step_x // 2, step_x):
        for y in range(top + step_y // 4, height, step_y):
            cv2.rectangle(colour, (x, y), (x + int(share[0] * step_x), y + int(share[1] * step_y)), pane, cv2.FILLED)


def _trees(rng: np.random.Generator, colour: Floats, strength: float) -> None:
    """Blobs of leaves, dark and bright by turns."""
    height, width = colour.shape[:2]
    leaves = clouded(rng, height, width, int(rng.integers(8, 50)))
    shape = clouded(rng, height, width, int(rng.integers(2, 7)))
    green = np.array([rng.uniform(0.03, 0.25), rng.uniform(0.1, 0.45), rng.uniform(0.05, 0.35)]) * strength
    where = shape > rng.uniform(-0.5, 0.5)
    colour[where] = (green * (1 + 0.8 * leaves[..., None]))[where]


def _bar(rng: np.random.Generator, colour: Floats, strength: float) -> None:
    """A line: pole, trunk, cable, rail."""
    height, width = colour.shape[:2]
    start, end = rng.integers(-20, max(width, height) + 20, (2, 2)).tolist()
    if rng.random() < 0.6:
        end[0] = start[0]
    thick = int(rng.integers(1, max(2, width // 12)))
    cv2.line(colour, tuple(start), tuple(end), _tuple(_colour(rng) * strength), thick)


def _tuple(colour: Floats) -> tuple[float, float, float]:
    blue, green, red = colour.tolist()
    return blue, green, red
