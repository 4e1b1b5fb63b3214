"""Frames of a run to page through: the image, and layers over it that can be switched."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from meshslam.geometry import Bytes
from meshslam.maps import object_colour
from meshslam.perception import Detection
from meshslam.viewing.context import ReportContext
from meshslam.viewing.markup import jpeg_uri, png_uri, px, rgb, text
from meshslam.viewing.mesh_layer import Box, mesh_layer, scaled_camera, shapes_of
from meshslam.viewing.overlay import (
    LABEL_HEIGHT_PX,
    colour_of,
    draw_overlay,
    keypoint_colour,
    label_width,
    mask_contours,
    place_labels,
    unseen,
    visible_keypoints,
)

FRAMES = 8
WIDEST_PX = 1280
THUMB_PX = 220
CONTOUR_TOLERANCE_PX = 0.6


def choose_frames(context: ReportContext, count: int = FRAMES) -> list[int]:
    """Indices spread over the run: of each of `count` equal parts, the frame that shows mapped objects largest."""
    parts = np.array_split(np.arange(len(context.frame_ids)), min(count, len(context.frame_ids)) or 1)
    return [max(part.tolist(), key=lambda i: _shown_px(context, i)) for part in parts if len(part)]


def _shown_px(context: ReportContext, index: int) -> float:
    found = [d for d in context.found_at(index) if d.track_id in context.mapped_ids]
    return sum(d.bbox[2] * d.bbox[3] for d in found)


def filmstrip(context: ReportContext, indices: Sequence[int]) -> str:
    """The frames, and a strip of thumbnails below."""
    frames, thumbs = [], []
    for place, index in enumerate(indices):
        image = None if context.read_image is None else context.read_image(index)
        frames.append(_frame(context, index, image, hidden=place > 0))
        thumbs.append(_thumb(context, index, image, current=place == 0))
    return f"<div class=frames>{''.join(frames)}</div><div class=strip>{''.join(thumbs)}</div>"


def keypoint_legend(context: ReportContext) -> str:
    """Names of the key points in their colours; empty if no detection has any."""
    if not any(visible_keypoints(d) for d in context.detections.detections):
        return ""
    names = max((c.keypoints for c in context.detections.categories), key=len, default=())
    colours = [rgb(keypoint_colour(i, len(names))) for i in range(len(names))]
    chips = "".join(
        f'<span><i style="background:{c}"></i>{text(n)}</span>' for c, n in zip(colours, names, strict=True)
    )
    return f'<div class="legend points">{chips}</div>'


def _frame(context: ReportContext, index: int, image: Bytes | None, *, hidden: bool) -> str:
    """One frame as SVG in the image's own pixels."""
    camera, found = context.camera, context.found_at(index)
    small = scaled_camera(camera, min(1.0, WIDEST_PX / camera.width))
    faint = unseen(context.mapped_ids, found)
    layer = mesh_layer(small, context.world_from_camera[index], shapes_of(context.map), faint)
    enlarged = camera.width / small.width
    boxes = {n: _scaled(box, enlarged) for n, box in layer.boxes.items()}
    scale = camera.width / 1240
    whole = f'x="-0.5" y="-0.5" width="{camera.width}" height="{camera.height}"'
    photo = "" if image is None else f'<image {whole} href="{jpeg_uri(_sized(image, small.width, small.height))}"/>'
    meshes = f'<image class=meshes {whole} href="{png_uri(layer.bgra)}"/>' if boxes else ""
    layers = (
        ("masks", "".join(_mask(context, d) for d in found)),
        ("boxes", "".join(_box(context, d) for d in found)),
    )
    under = "".join(f"<g class={name}>{content}</g>" for name, content in layers)
    points = "".join(_points(d, scale) for d in found)
    labels = "".join(_label(n, corner, scale) for n, corner in place_labels(boxes, faint, scale).items())
    title = f"frame {context.frame_ids[index]}"
    return (
        f'<svg class=frame role=img aria-label="{title}" viewBox="-0.5 -0.5 {camera.width} {camera.height}"'
        f"{' hidden' if hidden else ''}><rect class=ground {whole}/>{photo}{under}{meshes}"
        f"<g class=points>{points}</g><g class=labels>{labels}</g></svg>"
    )


def _thumb(context: ReportContext, index: int, image: Bytes | None, *, current: bool) -> str:
    drawn = draw_overlay(image, context.camera, context.world_from_camera[index], context.map, context.found_at(index))
    small = scaled_camera(context.camera, min(1.0, THUMB_PX / context.camera.width))
    frame = context.frame_ids[index]
    uri = jpeg_uri(_sized(drawn, small.width, small.height), 70)
    pressed = "true" if current else "false"
    return f'<button type=button aria-pressed={pressed}><img alt="" src="{uri}"><span>{frame}</span></button>'


def _sized(image: Bytes, width: int, height: int) -> Bytes:
    if image.shape[1] == width:
        return image
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def _scaled(box: Box, scale: float) -> Box:
    x0, y0, x1, y1 = ((v + 0.5) * scale - 0.5 for v in box)
    return x0, y0, x1, y1


def _name(detection: Detection) -> str:
    track = "no track" if detection.track_id is None else f"track {detection.track_id}"
    return f"{text(detection.category)} {detection.score:.2f}, {track}"


def _mask(context: ReportContext, detection: Detection) -> str:
    """A mask's borders as one path, filled by the even-odd rule."""
    borders = [
        cv2.approxPolyDP(c.astype(np.float32)[:, None], CONTOUR_TOLERANCE_PX, True)[:, 0]
        for c in mask_contours(detection.mask())
    ]
    path = "".join("M" + "L".join(f"{px(x)},{px(y)}" for x, y in c.tolist()) + "z" for c in borders if len(c) > 2)
    colour = rgb(colour_of(detection, context.mapped_ids))
    return f'<path d="{path}" fill="{colour}"><title>{_name(detection)}</title></path>' if path else ""


def _box(context: ReportContext, detection: Detection) -> str:
    x, y, width, height = (px(v) for v in detection.bbox)
    colour = rgb(colour_of(detection, context.mapped_ids))
    return (
        f'<rect x="{x}" y="{y}" width="{width}" height="{height}" stroke="{colour}">'
        f"<title>{_name(detection)}</title></rect>"
    )


def _points(detection: Detection, scale: float) -> str:
    count = 0 if detection.keypoints is None else len(detection.keypoints)
    return "".join(
        f'<circle cx="{px(x)}" cy="{px(y)}" r="{px(3.5 * scale)}" fill="{rgb(keypoint_colour(i, count))}"/>'
        for i, (x, y) in visible_keypoints(detection)
    )


def _label(number: int, corner: tuple[float, float], scale: float) -> str:
    (x, y), width = corner, label_width(number) * scale
    height = LABEL_HEIGHT_PX * scale
    return (
        f'<rect x="{px(x)}" y="{px(y)}" width="{px(width)}" height="{px(height)}" rx="{px(3 * scale)}"'
        f' fill="{rgb(object_colour(number))}"/><text x="{px(x + width / 2)}" y="{px(y + 0.79 * height)}"'
        f' font-size="{px(0.82 * height)}">{number}</text>'
    )
