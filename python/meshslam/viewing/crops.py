"""Small pictures of each object: the category's mean at its first estimate, and the instance."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from meshslam.geometry import Bytes, Camera
from meshslam.maps import MapObject
from meshslam.perception import Detection
from meshslam.viewing.context import ReportContext
from meshslam.viewing.markup import jpeg_uri, size_m, text
from meshslam.viewing.mesh_layer import Shape, mesh_layer, shape_of
from meshslam.viewing.overlay import blank_or_copy, colour_of, draw_mask

OBJECTS = 24  # at most: those seen in most views
CROP_PX = (300, 200)  # width, height
MARGIN = 0.22  # of the box, on every side


def choose_crops(context: ReportContext) -> dict[int, tuple[int, Detection]]:
    """By object, ascending: index and detection of the frame that shows it largest; empty without stages."""
    stages = context.stages or {}
    best = {thing.id: _largest(context, thing.id) for thing in context.map.objects if thing.id in stages}
    shown = [thing for thing in context.map.objects if best.get(thing.id) is not None]
    most = sorted(sorted(shown, key=lambda thing: -thing.views)[:OBJECTS], key=lambda thing: thing.id)
    return {thing.id: view for thing in most if (view := best[thing.id]) is not None}


def crops(pairs: Sequence[str]) -> str:
    """Pairs of pictures beside each other; empty without any."""
    return f"<div class=crops>{''.join(pairs)}</div>" if pairs else ""


def _largest(context: ReportContext, object_id: int) -> tuple[int, Detection] | None:
    """Index and detection of the frame that shows an object largest, those that cut it only if there is no other."""
    at = {frame: i for i, frame in enumerate(context.frame_ids)}
    seen = [d for d in context.detections.by_track().get(object_id, ()) if d.frame in at]
    best = max(seen, key=lambda d: (not _cut(d), d.bbox[2] * d.bbox[3]), default=None)
    return None if best is None else (at[best.frame], best)


def _cut(detection: Detection) -> bool:
    x, y, width, height = detection.bbox
    rows, columns = detection.image_size
    return min(x, y, columns - x - width, rows - y - height) < 2


def draw_pair(context: ReportContext, thing: MapObject, index: int, detection: Detection, image: Bytes | None) -> str:
    """An object's two pictures in a frame, whose image is given where there is one."""
    canvas = blank_or_copy(image, context.camera)
    if image is None:
        draw_mask(canvas, detection, colour_of(detection, context.mapped_ids))
    pose, mean = (context.stages or {})[thing.id]
    shapes = Shape(thing.id, pose, mean, thing.faces), shape_of(thing)
    pictures = [jpeg_uri(_crop(context, canvas, index, detection, shape), 82) for shape in shapes]
    sizes = [f"{size_m(np.ptp(s.vertices, axis=0))} m" for s in shapes]
    figures = "".join(
        f'<div><img alt="{what}" src="{uri}"><span>{what}<br><b>{size}</b></span></div>'
        for what, uri, size in zip(("mean", "instance"), pictures, sizes, strict=True)
    )
    caption = f"{text(thing.category)} {thing.id}, frame {context.frame_ids[index]}"
    return f"<figure>{figures}<figcaption>{caption}</figcaption></figure>"


def _crop(context: ReportContext, canvas: Bytes, index: int, detection: Detection, shape: Shape) -> Bytes:
    """The surroundings of a detection, enlarged, with one mesh over them."""
    camera, (left, top, width) = context.camera, _window(detection)
    scale = CROP_PX[0] / width
    fx, fy, skew = camera.fx * scale, camera.fy * scale, camera.skew * scale
    centre = ((camera.cx - left + 0.5) * scale - 0.5, (camera.cy - top + 0.5) * scale - 0.5)
    zoomed = Camera(CROP_PX[0], CROP_PX[1], fx, fy, *centre, skew)
    move = np.array([[scale, 0, 0.5 * scale - 0.5 - left * scale], [0, scale, 0.5 * scale - 0.5 - top * scale]])
    ground = cv2.warpAffine(canvas, move, CROP_PX, flags=cv2.INTER_LINEAR, borderValue=(40, 40, 40))
    layer = mesh_layer(zoomed, context.world_from_camera[index], (shape,))
    return layer.over(np.asarray(ground, np.uint8))


def _window(detection: Detection) -> tuple[float, float, float]:
    """Left, top and width of the surroundings in the pictures' proportions, inside the image if they fit."""
    x, y, width, height = detection.bbox
    proportion = CROP_PX[0] / CROP_PX[1]
    wide = max(width * (1 + 2 * MARGIN), height * (1 + 2 * MARGIN) * proportion, 1.0)
    tall = wide / proportion
    rows, columns = detection.image_size
    left, top = x + (width - wide) / 2, y + (height - tall) / 2
    left = min(max(left, 0.0), columns - wide) if wide < columns else left
    top = min(max(top, 0.0), rows - tall) if tall < rows else top
    return left, top, wide
