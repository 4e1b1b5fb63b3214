"""From detections to views: distance to the observed border, which of it is the object's own, key points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from meshslam.geometry import Bools, Bytes, Camera, Floats, ObjectModel, Pose, Singles, View
from meshslam.objects.config import ObjectConfig
from meshslam.perception import Detection

_BLUR_REACH_PX = 6  # pixels farther off do not change a smoothed slope


@dataclass(frozen=True, eq=False)
class Crop:
    """The part of an image that holds a detection with some room around it."""

    x0: int
    y0: int
    width: int
    height: int

    def of(self, picture: Bytes) -> Bytes:
        """Cut a picture (h, w) of the whole image."""
        return picture[self.y0 : self.y0 + self.height, self.x0 : self.x0 + self.width]


def crop_around(detection: Detection, camera: Camera, margin: float) -> Crop:
    """The detection's box with `margin` of its size, at least 24 px, around it; within the image."""
    x, y, w, h = detection.bbox
    room = max(24.0, margin * max(w, h))
    x0, y0 = max(0, int(x - room)), max(0, int(y - room))
    x1, y1 = min(camera.width, int(x + w + room) + 1), min(camera.height, int(y + h + room) + 1)
    return Crop(x0, y0, max(1, x1 - x0), max(1, y1 - y0))


def solid(mask: Bytes) -> Bytes:
    """Fill a mask's holes and drop its specks (parts under 2% of its area)."""
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    areas = [cv2.contourArea(c) for c in contours]
    kept = [c for c, a in zip(contours, areas, strict=True) if a >= 0.02 * sum(areas)]
    filled = np.zeros_like(mask)
    cv2.drawContours(filled, kept, -1, 1, cv2.FILLED)
    return filled


def signed_distance(mask: Bytes) -> Singles:
    """Distance (h, w) of each pixel to the mask's border, px, negative inside; nothing lies beyond the picture.

    Without a border all is as far off as the picture reaches.
    """
    x, y, w, h = cv2.boundingRect(mask)
    if w == 0:
        return np.full(mask.shape, np.hypot(*mask.shape), np.float32)
    distance = _distance_to_zero(1 - mask) - np.float32(0.5)
    box = np.pad(mask[y : y + h, x : x + w], 1)  # nothing inside is farther from the border than the box reaches
    inside = _distance_to_zero(box)[1:-1, 1:-1]
    np.copyto(distance[y : y + h, x : x + w], np.float32(0.5) - inside, where=inside > 0)
    return distance


def _distance_to_zero(picture: Bytes) -> Singles:
    """Distance to the nearest zero: the root of a whole number; OpenCV's last bits are others each time."""
    found = cv2.distanceTransform(picture, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.sqrt(np.rint(np.square(found, out=found), out=found), out=found)


@dataclass(frozen=True, eq=False)
class Border:
    """Points of a mask's border in its crop."""

    pixels: Floats  # (n, 2)
    lengths_px: Floats  # (n,)
    own: Bools  # (n,)
    cut: Bytes  # (h, w), 1 where the nearest border is not the object's own


def trace_border(mask: Bytes, distance_px: Singles, not_own: Bytes, step_px: float) -> Border:
    """Walk a mask's contours; `not_own` (h, w) marks pixels whose border belongs to the image's edge or an occluder."""
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    contour_pixels = np.ones_like(mask)
    points: list[Floats] = []
    lengths: list[Floats] = []
    for contour in contours:
        chain = contour[:, 0, :]
        contour_pixels[chain[:, 1], chain[:, 0]] = 0
        steps = np.linalg.norm(np.roll(chain, -1, axis=0) - chain, axis=1)
        count = max(1, round(float(steps.sum()) / step_px))
        at = np.linspace(0, len(chain), count, endpoint=False).astype(int)
        points.append(chain[at].astype(float))
        lengths.append(np.full(count, float(steps.sum()) / count))
    if not points:
        return Border(np.zeros((0, 2)), np.zeros(0), np.zeros(0, bool), np.zeros_like(mask))
    chains = np.concatenate(points)
    at_x, at_y = chains.astype(int).T
    own = not_own[at_y, at_x] == 0
    return Border(_onto_border(chains, distance_px), np.concatenate(lengths), own, _spread(contour_pixels, not_own))


def _onto_border(inner: Floats, distance_px: Singles) -> Floats:
    """Contours run through the outermost pixels of a mask, to its border.

    Along a slanted border they hold one pixel of every column, or of every row: the border is on average half a pixel
    further out along that axis, which is 0.5 max(|n_x|, |n_y|) along the normal n.
    """
    x, y = inner.astype(int).T
    left, top = max(0, x.min() - _BLUR_REACH_PX), max(0, y.min() - _BLUR_REACH_PX)
    near = distance_px[top : y.max() + _BLUR_REACH_PX + 1, left : x.max() + _BLUR_REACH_PX + 1]
    smooth = cv2.GaussianBlur(near, (0, 0), 1.0)
    dx = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3) / 8
    dy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3) / 8
    normal = np.stack([dx[y - top, x - left], dy[y - top, x - left]], axis=1).astype(float)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-6)
    moved: Floats = inner + 0.5 * np.abs(normal).max(1, keepdims=True) * normal
    return moved


def _spread(contour_pixels: Bytes, not_own: Bytes) -> Bytes:
    """Give each pixel the mark of the contour pixel nearest to it."""
    if not (not_own[contour_pixels == 0]).any():
        return np.zeros_like(not_own)
    _, labels = cv2.distanceTransformWithLabels(
        contour_pixels, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    mark_of_label = np.zeros(int(labels.max()) + 1, np.uint8)
    y, x = np.nonzero(contour_pixels == 0)
    mark_of_label[labels[y, x]] = not_own[y, x]
    marks: Bytes = mark_of_label[labels]
    return marks


def view_bytes(detection: Detection, camera: Camera, config: ObjectConfig) -> int:
    """Memory of a detection's view: a distance, and what is cut and hidden, of each pixel of its crop."""
    crop = crop_around(detection, camera, config.crop_margin)
    return 6 * crop.width * crop.height


def near_edge(crop: Crop, camera: Camera, margin_px: int) -> Bytes:
    """Mark the crop's pixels (h, w) within `margin_px` of the image's edge."""
    x, y = np.arange(crop.x0, crop.x0 + crop.width), np.arange(crop.y0, crop.y0 + crop.height)
    columns = (x < margin_px) | (x >= camera.width - margin_px)
    rows = (y < margin_px) | (y >= camera.height - margin_px)
    return (rows[:, None] | columns[None, :]).astype(np.uint8)


def make_view(
    model: ObjectModel,
    camera: Camera,
    world_from_camera: Pose,
    time_s: float,
    detection: Detection,
    occluder: Bytes,
    keypoint_order: Sequence[int],
    config: ObjectConfig,
    mask_in_image: Bytes | None = None,
) -> View:
    """What one detection shows of its object.

    `occluder` (h, w) of the image marks what stands before the object; `keypoint_order[i]` is the category's number of
    the detection's i-th key point, -1 for none. `mask_in_image` (h, w) is the detection's mask where it is at hand.
    """
    crop = crop_around(detection, camera, config.crop_margin)
    mask = solid(crop.of(detection.mask() if mask_in_image is None else mask_in_image))
    hidden = crop.of(occluder) * (1 - mask)
    reach = 2 * config.occluder_margin_px + 1
    near_hidden = cv2.dilate(hidden, np.ones((reach, reach), np.uint8)).astype(np.uint8)
    not_own = near_hidden | near_edge(crop, camera, config.edge_margin_px)
    distance_px = signed_distance(mask)
    border = trace_border(mask, distance_px, not_own, config.border_step_px)
    index, pixels, sigma_px = keypoints_of(detection, keypoint_order, config)
    return model.view(
        camera,
        world_from_camera,
        time_s=time_s,
        origin=(crop.x0, crop.y0),
        distance_px=distance_px,
        cut=border.cut > 0,
        hidden=hidden > 0,
        border=border.pixels + [crop.x0, crop.y0],
        border_length_px=border.lengths_px,
        border_own=border.own,
        keypoint_index=index,
        keypoint_pixels=pixels,
        keypoint_sigma_px=sigma_px,
    )


def keypoints_of(
    detection: Detection, keypoint_order: Sequence[int], config: ObjectConfig
) -> tuple[np.ndarray, Floats, Floats]:
    """Key points worth using: the category's numbers (k,), pixels (k, 2), sigmas (k,).

    A point's sigma, where the detection gives none, is a share of the box's size, larger for a lower score.
    """
    if detection.keypoints is None or detection.keypoint_scores is None:
        return np.zeros(0, int), np.zeros((0, 2)), np.zeros(0)
    order = np.asarray(keypoint_order, int)
    good = (detection.keypoint_scores >= config.min_keypoint_score) & (order >= 0)
    if detection.keypoint_sigmas_px is not None:
        given = np.maximum(config.min_keypoint_sigma_px, detection.keypoint_sigmas_px[good])
        return order[good], detection.keypoints[good], given
    size = max(detection.bbox[2:])
    sigma = max(config.min_keypoint_sigma_px, config.keypoint_sigma_share * size)
    sigmas = sigma / np.sqrt(np.clip(detection.keypoint_scores[good], 0.1, 1.0))
    return order[good], detection.keypoints[good], sigmas
