"""Light and surroundings of a scene: sun, sky, what stands on the horizon and mirrors in paint and glass."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Bools, Floats


@dataclass(frozen=True, eq=False)
class Light:
    """Sun and sky; directions in the world, z up."""

    sun: Floats  # (3,), unit, towards the sun
    sun_strength: float  # 0 under clouds
    ambient: float
    tint: Floats  # (3,) BGR
    sky_low: Floats
    sky_high: Floats
    horizon: Floats  # (3,), colour of houses and trees around
    ground: Floats  # (3,)
    waves: Floats  # (6,), phases of the skyline
    skyline: float  # its height, sine of the elevation


def draw_light(rng: np.random.Generator) -> Light:
    """Draw a sunny, cloudy or shaded scene."""
    elevation, azimuth = np.radians(rng.uniform(8, 70)), rng.uniform(0, 2 * np.pi)
    sun = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    sunny = rng.random() < 0.6
    warm = rng.normal(0, 0.06)
    blue = np.array([0.95, 0.75, 0.55]) if rng.random() < 0.5 else np.array([0.9, 0.88, 0.86])
    return Light(
        sun=sun,
        sun_strength=float(rng.uniform(0.5, 1.3)) if sunny else 0.0,
        ambient=float(rng.uniform(0.25, 0.6) if sunny else rng.uniform(0.4, 1.0)),
        tint=np.array([1 - warm, 1.0, 1 + warm]),
        sky_low=np.clip(rng.uniform(0.8, 1.2) * np.ones(3), 0, 1.2),
        sky_high=blue * rng.uniform(0.7, 1.1),
        horizon=np.clip(rng.uniform(0.05, 0.45) + rng.normal(0, 0.05, 3), 0.01, 1),
        ground=np.clip(rng.uniform(0.12, 0.45) + rng.normal(0, 0.02, 3), 0.01, 1),
        waves=rng.uniform(0, 2 * np.pi, 6),
        skyline=float(rng.uniform(0.0, 0.5)),
    )


def surroundings(light: Light, rays: Floats) -> Floats:
    """Colours (n, 3) that come from directions (n, 3) of unit length."""
    up = rays[:, 2]
    around = np.arctan2(rays[:, 1], rays[:, 0])
    rough = sum(np.sin((k + 1) * 2 * around + light.waves[k]) for k in range(4)) / 4.0
    edge = light.skyline * (0.6 + 0.6 * rough)
    sky = light.sky_low + (light.sky_high - light.sky_low) * np.sqrt(np.clip(up, 0, 1))[:, None]
    shade = 0.8 + 0.3 * np.sin(9 * around + light.waves[4]) * np.sin(14 * up + light.waves[5])
    colour = np.where((up < edge)[:, None], light.horizon * shade[:, None], sky)
    below: Floats = np.where((up < 0)[:, None], light.ground * (1 - 0.5 * np.clip(-up, 0, 1))[:, None], colour)
    return below


def lit(light: Light, normals: Floats, sunny: Bools | None = None) -> Floats:
    """Light (n, 3) that falls on surfaces with normals (n, 3); `sunny` (n,) tells where nothing hides the sun."""
    sun = np.maximum(normals @ light.sun, 0.0) * light.sun_strength
    if sunny is not None:
        sun = sun * sunny
    sky = light.ambient * (0.62 + 0.38 * normals[:, 2])
    total: Floats = (sun + sky)[:, None] * light.tint
    return total


def shaded(
    light: Light,
    colour: Floats,
    mirror: Floats,
    rays: Floats,
    normals: Floats,
    height_m: Floats,
    sunny: Bools | None = None,
) -> Floats:
    """Colours (n, 3) of surfaces seen along unit rays (n, 3): diffuse light and a mirror image (Schlick 1994)."""
    along = np.clip(-(rays * normals).sum(1), 0, 1)[:, None]
    mirrored = rays + 2 * along * normals
    share = mirror[:, None] + (1 - mirror[:, None]) * np.minimum(1.0, 5 * mirror[:, None]) * (1 - along) ** 4
    occluded = np.clip(0.35 + height_m, 0.35, 1.0)[:, None]
    diffuse = colour * lit(light, normals, sunny) * occluded
    around = np.zeros_like(diffuse)
    shiny = mirror > 0
    around[shiny] = surroundings(light, mirrored[shiny]) * np.clip(0.3 + 2 * light.ambient, 0, 1)
    glint = np.maximum(mirrored @ light.sun, 0.0) ** 60 * light.sun_strength * np.minimum(1.0, 8 * mirror)
    if sunny is not None:
        glint = glint * sunny
    total: Floats = diffuse * (1 - share) + around * share + glint[:, None]
    return total
