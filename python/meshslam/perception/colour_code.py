"""Colours that say what a pixel shows: bodies in pale hues, their key points in full ones, all else grey.

Hue and saturation stay as they are when a surface is darker, so that shading does not disturb the code.
"""

from __future__ import annotations

import colorsys

import numpy as np

from meshslam.geometry import Bools, Bytes, Floats, Ints

HUES = 12  # of bodies, and of key points
BODY_SATURATION, POINT_SATURATION = 0.55, 1.0
_LEAST_SATURATION, _POINT_FROM = 0.25, 0.8  # halfway between grey and bodies, bodies and key points
_LEAST_BRIGHTNESS = 30  # of 255, the largest channel


def body_colour_bgr(number: int) -> Floats:
    """Colour (3,), 0 to 1, of body `number`; after `HUES` bodies the colours come again."""
    return _colour(number, BODY_SATURATION)


def point_colour_bgr(index: int) -> Floats:
    """Colour (3,), 0 to 1, of a key point by its place among the names."""
    return _colour(index, POINT_SATURATION)


def _colour(number: int, saturation: float) -> Floats:
    red, green, blue = colorsys.hsv_to_rgb((number % HUES) / HUES, saturation, 1.0)
    return np.array([blue, green, red])


def read_colours(image_bgr: Bytes) -> tuple[Ints, Bools, Bools]:
    """Hue number of each pixel of an image (h, w, 3), where bodies are, and where key points are: each (h, w)."""
    channels = image_bgr.astype(np.int32)
    blue, green, red = np.moveaxis(channels, -1, 0)
    top, spread = channels.max(-1), np.ptp(channels, axis=-1)
    span = np.maximum(spread, 1)
    sixth = np.where(
        top == red,
        (green - blue) / span % 6.0,
        np.where(top == green, 2.0 + (blue - red) / span, 4.0 + (red - green) / span),
    )
    hue = np.round(sixth * HUES / 6.0).astype(np.int64) % HUES
    saturation = spread / np.maximum(top, 1)
    coloured = (saturation > _LEAST_SATURATION) & (top >= _LEAST_BRIGHTNESS)
    points = coloured & (saturation > _POINT_FROM)
    return hue, coloured & ~points, points
