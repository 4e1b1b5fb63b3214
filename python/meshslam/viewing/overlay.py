"""One frame with what was detected and what is in the map."""

from __future__ import annotations

import colorsys
from collections.abc import Collection, Mapping, Sequence

import cv2
import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry import Bytes, Camera, Floats, Pose
from meshslam.maps import Map, object_colour
from meshslam.perception import Detection
from meshslam.viewing.mesh_layer import Box, mesh_layer, shapes_of

GROUND = 216  # grey, where there is no image
UNMAPPED_RGB = (150, 150, 150)
MASK_OPACITY = 0.25
LABEL_HEIGHT_PX, CHARACTER_PX = 14, 8
SMALLEST_LABELLED_PX, FAINT_LABELLED_PX = 8, 32  # longer side of what is visible of an object
FONT = cv2.FONT_HERSHEY_SIMPLEX


def draw_overlay(
    image: Bytes | None,
    camera: Camera,
    world_from_camera: Pose,
    scene_map: Map,
    detections: Sequence[Detection],
) -> Bytes:
    """Draw one frame's detections (masks, boxes, key points) and the map's meshes with their numbers.

    `image` is BGR (h, w, 3), or None for a grey ground; so is the result. What belongs to an object of the map has
    its colour, the rest is grey. Meshes that no detection shows in this frame are outlined. GeometryError if the image
    is not of the camera's size.
    """
    canvas = blank_or_copy(image, camera)
    mapped = {thing.id for thing in scene_map.objects}
    for d in detections:
        draw_mask(canvas, d, colour_of(d, mapped))
    faint = unseen(mapped, detections)
    layer = mesh_layer(camera, world_from_camera, shapes_of(scene_map), faint)
    canvas = layer.over(canvas)
    for d in detections:
        _draw_box(canvas, d, colour_of(d, mapped))
        _draw_keypoints(canvas, d)
    for number, corner in place_labels(layer.boxes, faint).items():
        _draw_label(canvas, number, corner)
    return canvas


def blank_or_copy(image: Bytes | None, camera: Camera) -> Bytes:
    """Copy an image, or make an empty one of the camera's size."""
    size = (camera.height, camera.width, 3)
    if image is None:
        return np.full(size, GROUND, np.uint8)
    if image.shape != size:
        raise GeometryError(f"an image of the camera is (h, w, 3) = {size}, found {image.shape}")
    return image.copy()


def unseen(mapped: Collection[int], detections: Sequence[Detection]) -> set[int]:
    """Objects of the map that no detection of a frame shows."""
    return set(mapped) - {d.track_id for d in detections if d.track_id is not None}


def colour_of(detection: Detection, mapped: Collection[int]) -> tuple[int, int, int]:
    """RGB of a detection: its object's, or grey."""
    if detection.track_id is None or detection.track_id not in mapped:
        return UNMAPPED_RGB
    r, g, b = object_colour(detection.track_id).tolist()
    return r, g, b


def keypoint_colour(index: int, count: int) -> tuple[int, int, int]:
    """RGB of a key point by its place among the category's names: hues around the circle, two brightnesses in turn."""
    r, g, b = colorsys.hsv_to_rgb(index / max(count, 1), 0.85, 1.0 if index % 2 else 0.78)
    return round(255 * r), round(255 * g), round(255 * b)


def mask_contours(mask: Bytes) -> list[Floats]:
    """Borders (n, 2) of a mask, px; holes too: filled by the even-odd rule they are the mask again."""
    found, _ = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    return [np.asarray(c, float).reshape(-1, 2) for c in found if len(c) > 2]


def place_labels(
    boxes: Mapping[int, Box], faint: Collection[int] = (), scale: float = 1.0
) -> dict[int, tuple[float, float]]:
    """Top-left corners of the labels over visible boxes, larger boxes first; one that would hide another moves up.

    Small boxes have no label, those of `faint` objects already where they are as small as a label.
    """
    height = LABEL_HEIGHT_PX * scale
    placed: dict[int, tuple[float, float]] = {}
    for number, (x0, y0, x1, y1) in sorted(boxes.items(), key=lambda item: item[1][1] - item[1][3]):
        smallest = FAINT_LABELLED_PX if number in faint else SMALLEST_LABELLED_PX
        if max(x1 - x0, y1 - y0) < smallest * scale:
            continue
        x, y = (x0 + x1 - label_width(number) * scale) / 2, y0 - height - 3 * scale
        for _ in placed:
            above = [py for other, (px, py) in placed.items() if _collide(x - px, y - py, number, other, scale)]
            y = min(above) - height - scale if above else y
        placed[number] = (max(x, 0.0), max(y, 0.0))
    return placed


def label_width(number: int) -> float:
    """Width of a label, px."""
    return CHARACTER_PX * len(str(number)) + 8.0


def _collide(dx: float, dy: float, number: int, other: int, scale: float) -> bool:
    width = label_width(other) if dx > 0 else label_width(number)
    return abs(dx) < width * scale and abs(dy) < LABEL_HEIGHT_PX * scale


def draw_mask(canvas: Bytes, detection: Detection, colour_rgb: tuple[int, int, int]) -> None:
    """Tint a detection's mask, and draw its border."""
    mask = detection.mask() > 0
    colour = np.array(colour_rgb[::-1], float)
    canvas[mask] = np.round((1 - MASK_OPACITY) * canvas[mask] + MASK_OPACITY * colour).astype(np.uint8)
    borders = [np.round(c).astype(np.int32) for c in mask_contours(mask.astype(np.uint8))]
    cv2.polylines(canvas, borders, True, (255, 255, 255), 1, cv2.LINE_AA)


def _draw_box(canvas: Bytes, detection: Detection, colour_rgb: tuple[int, int, int]) -> None:
    x, y, width, height = detection.bbox
    ends = (round(x), round(y)), (round(x + width) - 1, round(y + height) - 1)
    cv2.rectangle(canvas, *ends, colour_rgb[::-1], 1)


def _draw_keypoints(canvas: Bytes, detection: Detection) -> None:
    for index, pixel in visible_keypoints(detection):
        count = 0 if detection.keypoints is None else len(detection.keypoints)
        centre = round(pixel[0]), round(pixel[1])
        cv2.circle(canvas, centre, 4, (255, 255, 255), -1, cv2.LINE_AA)
        cv2.circle(canvas, centre, 3, keypoint_colour(index, count)[::-1], -1, cv2.LINE_AA)


def visible_keypoints(detection: Detection) -> list[tuple[int, tuple[float, float]]]:
    """The key points that carry information: place among the names, pixel."""
    if detection.keypoints is None or detection.keypoint_scores is None:
        return []
    rows = zip(detection.keypoints.tolist(), detection.keypoint_scores.tolist(), strict=True)
    return [(i, (x, y)) for i, ((x, y), score) in enumerate(rows) if score > 0]


def _draw_label(canvas: Bytes, number: int, corner: tuple[float, float]) -> None:
    x, y = round(corner[0]), round(corner[1])
    end = x + round(label_width(number)), y + LABEL_HEIGHT_PX
    r, g, b = object_colour(number).tolist()
    cv2.rectangle(canvas, (x, y), end, (b, g, r), -1)
    cv2.putText(canvas, str(number), (x + 4, end[1] - 3), FONT, 0.42, (15, 15, 15), 1, cv2.LINE_AA)
