"""Detections in the pixels of a raw image, taken to the pinhole view that everything else works in."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from meshslam.geometry import Bools, Floats
from meshslam.perception.detections import Detection, DetectionSet
from meshslam.perception.faults import Faults
from meshslam.perception.masks import encode_mask
from meshslam.sequences import Distortion


def undistorted_detections(found: DetectionSet, lens: Distortion, faults: Faults) -> DetectionSet:
    """The detections as the lens' pinhole view shows them, under their ids; those outside it are left out, and told.

    Masks are resampled, boxes are theirs, key points that leave the view carry no information, and their sigmas grow
    with the local magnification.
    """
    if found.undistorted:
        return found
    every = [_undistorted(d, lens) for d in found.detections]
    kept = tuple(d for d in every if d is not None)
    gone = len(every) - len(kept)
    said = f"masks are those of the raw images: {len(kept)} detections are undistorted into the camera's pinhole view"
    faults.note(said if not gone else f"{said}, {gone} lie outside it and are left out")
    images = tuple(replace(i, width=lens.camera.width, height=lens.camera.height) for i in found.images)
    return replace(found, images=images, detections=kept, undistorted=True)


def _undistorted(detection: Detection, lens: Distortion) -> Detection | None:
    mask = (lens.undistort_image(detection.mask() * np.uint8(255)) >= 128).astype(np.uint8)
    if not mask.any():
        return None
    x, y, width, height = cv2.boundingRect(mask)
    box = (float(x), float(y), float(width), float(height))
    size = (mask.shape[0], mask.shape[1])
    seen = replace(detection, bbox=box, segmentation=encode_mask(mask), image_size=size)
    points, scores = detection.keypoints, detection.keypoint_scores
    return seen if points is None or scores is None else _with_points(seen, points, scores, lens)


def _with_points(detection: Detection, raw: Floats, scores: Floats, lens: Distortion) -> Detection:
    points = lens.undistort(raw)
    with np.errstate(invalid="ignore"):
        last = np.array([lens.camera.width, lens.camera.height]) - 0.5
        inside: Bools = np.all((points >= -0.5) & (points <= last), axis=1)
    sigmas = detection.keypoint_sigmas_px
    if sigmas is not None:
        sigmas = np.where(inside, sigmas * _magnification(lens, raw), sigmas)
    return replace(
        detection,
        keypoints=np.where(inside[:, None], points, 0.0),
        keypoint_scores=np.where(inside, scores, 0.0),
        keypoint_sigmas_px=sigmas,
    )


def _magnification(lens: Distortion, pixels: Floats) -> Floats:
    """Pixels of the view a raw pixel, along one axis, at raw pixels (n, 2): the root of the areas' ratio."""
    across, down = (lens.undistort(pixels + step) - lens.undistort(pixels - step) for step in 0.5 * np.eye(2))
    size: Floats = np.sqrt(np.abs(across[:, 0] * down[:, 1] - across[:, 1] * down[:, 0]))
    return size
