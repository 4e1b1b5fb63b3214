"""A frame with its overlay as a small picture, from parts that are drawn already."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from meshslam.geometry import AnyArray, Bytes, Camera, Floats
from meshslam.maps import object_colour
from meshslam.perception import Detection
from meshslam.viewing.mesh_layer import MeshLayer, scaled_camera
from meshslam.viewing.overlay import (
    GROUND,
    LABEL_HEIGHT_PX,
    MASK_OPACITY,
    keypoint_colour,
    label_width,
    visible_keypoints,
)

THUMB_PX = 220  # width
FINE = 2  # drawn at so many times the size, then reduced
SHIFT = 4  # bits of a pixel's fraction in drawing
WHITE = (255, 255, 255)


@dataclass(frozen=True, eq=False)
class Seen:
    """A detection with its mask's borders, in the image's own pixels."""

    detection: Detection
    borders: Sequence[Floats]  # each (n, 2), px
    colour: tuple[int, int, int]  # RGB


def thumbnail(
    image: Bytes | None,
    camera: Camera,
    layer: MeshLayer,
    view: Camera,
    seen: Sequence[Seen],
    labels: Mapping[int, tuple[float, float]],
) -> Bytes:
    """A picture BGR, at most THUMB_PX wide.

    `image` is the frame of `camera`, reduced or not, or None for a grey ground. `layer` belongs to the reduced camera
    `view`; detections and the labels' corners are in pixels of `camera`. Lines keep their share of the picture;
    numbers, which could not be read, are left out.
    """
    small = scaled_camera(camera, min(1.0, THUMB_PX / camera.width))
    fine = FINE * small.width, FINE * small.height
    scale = fine[0] / camera.width
    canvas = np.full((fine[1], fine[0], 3), GROUND, np.uint8) if image is None else _resized(image, fine)
    canvas = _with_faint(canvas, MASK_OPACITY, lambda drawn: _draw_masks(drawn, seen, scale))
    line = min(1.0, scale)  # a line narrower than a pixel is as much fainter
    canvas = _with_faint(canvas, line, lambda drawn: _draw_borders(drawn, seen, scale))
    canvas = _with_meshes(canvas, layer, view)
    canvas = _with_faint(canvas, line, lambda drawn: _draw_boxes(drawn, seen, scale))
    for thing in seen:
        _draw_points(canvas, thing.detection, scale)
    unit = scale * camera.width / 1240
    for number, corner in labels.items():
        _draw_label(canvas, number, corner, scale, unit)
    return np.asarray(_resized(canvas, (small.width, small.height)), np.uint8)


def _resized(image: AnyArray, size: tuple[int, int]) -> AnyArray:
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def _with_meshes(canvas: AnyArray, layer: MeshLayer, view: Camera) -> AnyArray:
    """The layer over the canvas, reduced with its colours multiplied with their opacity."""
    whole = np.zeros((view.height, view.width, 4), np.uint8)
    for patch in layer.patches:
        opacity = patch.bgra[..., 3:]
        colours = (patch.bgra[..., :3].astype(np.uint16) * opacity + 127) // 255
        whole[patch.inside] = np.concatenate([colours.astype(np.uint8), opacity], axis=-1)
    reduced = _resized(whole, (canvas.shape[1], canvas.shape[0]))
    covered = 1 - reduced[..., 3:] * np.float32(1 / 255)
    return np.minimum(np.rint(canvas * covered + reduced[..., :3]), 255).astype(np.uint8)


def _with_faint(canvas: AnyArray, opacity: float, draw: Callable[[AnyArray], None]) -> AnyArray:
    """The canvas with something drawn on it that lets it shine through."""
    drawn = canvas.copy()
    draw(drawn)
    return np.asarray(cv2.addWeighted(canvas, 1 - opacity, drawn, opacity, 0.0))


def _draw_masks(canvas: AnyArray, seen: Sequence[Seen], scale: float) -> None:
    for thing in seen:
        if thing.borders:
            cv2.fillPoly(canvas, _borders(thing, scale), thing.colour[::-1], cv2.LINE_AA, SHIFT)


def _draw_borders(canvas: AnyArray, seen: Sequence[Seen], scale: float) -> None:
    for thing in seen:
        cv2.polylines(canvas, _borders(thing, scale), True, WHITE, 1, cv2.LINE_AA, SHIFT)


def _borders(thing: Seen, scale: float) -> list[AnyArray]:
    return [_fixed(border, scale) for border in thing.borders]


def _draw_boxes(canvas: AnyArray, seen: Sequence[Seen], scale: float) -> None:
    for thing in seen:
        x, y, width, height = thing.detection.bbox
        ends = np.array([[x, y], [x + width - 1, y + height - 1]])
        (x0, y0), (x1, y1) = _fixed(ends, scale).tolist()
        cv2.rectangle(canvas, (x0, y0), (x1, y1), thing.colour[::-1], 1, cv2.LINE_AA, SHIFT)


def _draw_points(canvas: AnyArray, detection: Detection, scale: float) -> None:
    count = 0 if detection.keypoints is None else len(detection.keypoints)
    for index, pixel in visible_keypoints(detection):
        x, y = _fixed(np.array(pixel), scale).tolist()
        for radius, colour in ((4, WHITE), (3, keypoint_colour(index, count)[::-1])):
            cv2.circle(canvas, (x, y), round(radius * scale * (1 << SHIFT)), colour, -1, cv2.LINE_AA, SHIFT)


def _draw_label(canvas: AnyArray, number: int, corner: tuple[float, float], scale: float, unit: float) -> None:
    """A plain rectangle; `unit` is what a label's pixel is on the canvas."""
    x, y = (round(v * scale) for v in corner)
    end = x + max(1, round(label_width(number) * unit)) - 1, y + max(1, round(LABEL_HEIGHT_PX * unit)) - 1
    r, g, b = object_colour(number).tolist()
    cv2.rectangle(canvas, (x, y), end, (b, g, r), -1)


def _fixed(points: Floats, scale: float) -> AnyArray:
    """Points (..., 2) of the image on the canvas, in units of 1 / 2^SHIFT px, as OpenCV draws them."""
    return np.rint(((points + 0.5) * scale - 0.5) * (1 << SHIFT)).astype(np.int32)
