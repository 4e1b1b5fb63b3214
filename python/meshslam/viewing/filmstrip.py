"""Frames of a run to page through: the image, and layers over it that can be switched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from meshslam.geometry import Bytes
from meshslam.maps import object_colour
from meshslam.perception import Detection
from meshslam.viewing.context import ReportContext
from meshslam.viewing.markup import jpeg_uri, png_uri, px, rgb, text
from meshslam.viewing.mesh_layer import Box, MeshLayer, Rect, mesh_layer, scaled_camera, shapes_of
from meshslam.viewing.overlay import (
    LABEL_HEIGHT_PX,
    colour_of,
    keypoint_colour,
    label_width,
    mask_contours,
    place_labels,
    unseen,
    visible_keypoints,
)
from meshslam.viewing.thumbnail import Seen, thumbnail

FRAMES = 8
WIDEST_PX = 1280
CONTOUR_TOLERANCE_PX = 0.6


def choose_frames(context: ReportContext, count: int = FRAMES) -> list[int]:
    """Indices spread over the run: of each of `count` equal parts, the frame that shows mapped objects largest."""
    parts = np.array_split(np.arange(len(context.frame_ids)), min(count, len(context.frame_ids)) or 1)
    return [max(part.tolist(), key=lambda i: _shown_px(context, i)) for part in parts if len(part)]


def _shown_px(context: ReportContext, index: int) -> float:
    found = [d for d in context.found_at(index) if d.track_id in context.mapped_ids]
    return sum(d.bbox[2] * d.bbox[3] for d in found)


@dataclass(frozen=True)
class FramePicture:
    """One frame as drawn."""

    frame: int  # its number
    view: str  # attributes of an SVG in the image's own pixels
    content: str  # what is inside the SVG
    thumbnail: str  # data URI


def filmstrip(pictures: Sequence[FramePicture]) -> str:
    """The frames, the first of them shown, and a strip of thumbnails below."""
    frames, thumbs = [], []
    for place, picture in enumerate(pictures):
        hidden, pressed = (" hidden", "false") if place else ("", "true")
        frames.append(f"<svg class=frame {picture.view}{hidden}>{picture.content}</svg>")
        thumbs.append(
            f'<button type=button aria-pressed={pressed}><img alt="" src="{picture.thumbnail}">'
            f"<span>{picture.frame}</span></button>"
        )
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


def draw_frame(context: ReportContext, index: int, image: Bytes | None) -> FramePicture:
    """One frame with its layers, and its thumbnail; meshes are drawn and masks unpacked once for both."""
    camera, found = context.camera, context.found_at(index)
    small = scaled_camera(camera, min(1.0, WIDEST_PX / camera.width))
    faint = unseen(context.mapped_ids, found)
    layer = mesh_layer(small, context.world_from_camera[index], shapes_of(context.map), faint)
    shown = None if image is None else _sized(image, small.width, small.height)
    seen = [_seen(context, d) for d in found]
    scale, enlarged = camera.width / 1240, camera.width / small.width
    boxes = {n: _scaled(box, enlarged) for n, box in layer.boxes.items()}
    labels = place_labels(boxes, faint, scale)
    whole = f'x="-0.5" y="-0.5" width="{camera.width}" height="{camera.height}"'
    photo = "" if shown is None else f'<image {whole} href="{jpeg_uri(shown)}"/>'
    frame = context.frame_ids[index]
    content = (
        f"<rect class=ground {whole}/>{photo}<g class=masks>{''.join(map(_mask, seen))}</g>"
        f"<g class=boxes>{''.join(map(_box, seen))}</g>{_meshes(layer, enlarged)}"
        f"<g class=points>{''.join(_points(d, scale) for d in found)}</g>"
        f"<g class=labels>{''.join(_label(n, corner, scale) for n, corner in labels.items())}</g>"
    )
    return FramePicture(
        frame,
        f'role=img aria-label="frame {frame}" viewBox="-0.5 -0.5 {camera.width} {camera.height}"',
        content,
        jpeg_uri(thumbnail(shown, camera, layer, small, seen, labels), 70),
    )


def _seen(context: ReportContext, detection: Detection) -> Seen:
    return Seen(detection, mask_contours(detection.mask()), colour_of(detection, context.mapped_ids))


def _meshes(layer: MeshLayer, enlarged: float) -> str:
    """The layer's rectangles, at their places in the image's own pixels."""
    return "".join(f"<image class=meshes {_place(p.rect, enlarged)} href={png_uri(p.bgra)!r}/>" for p in layer.patches)


def _place(rect: Rect, enlarged: float) -> str:
    x, y, width, height = (f"{enlarged * side:.6g}" for side in rect)
    place = f'x="{x}" y="{y}" width="{width}" height="{height}" preserveAspectRatio="none"'
    return f'{place} transform="translate(-0.5 -0.5)"'


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


def _mask(seen: Seen) -> str:
    """A mask's borders as one path, filled by the even-odd rule."""
    borders = [cv2.approxPolyDP(c.astype(np.float32)[:, None], CONTOUR_TOLERANCE_PX, True)[:, 0] for c in seen.borders]
    path = "".join("M" + "L".join(f"{px(x)},{px(y)}" for x, y in c.tolist()) + "z" for c in borders if len(c) > 2)
    title = f"<title>{_name(seen.detection)}</title>"
    return f'<path d="{path}" fill="{rgb(seen.colour)}">{title}</path>' if path else ""


def _box(seen: Seen) -> str:
    x, y, width, height = (px(v) for v in seen.detection.bbox)
    return (
        f'<rect x="{x}" y="{y}" width="{width}" height="{height}" stroke="{rgb(seen.colour)}">'
        f"<title>{_name(seen.detection)}</title></rect>"
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
