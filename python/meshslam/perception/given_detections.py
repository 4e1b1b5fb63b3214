"""Detections that a stream is given, checked before anything is changed by them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from meshslam.errors import DetectionError
from meshslam.geometry import Camera
from meshslam.perception.detections import Detection
from meshslam.perception.masks import segmentation_problem


def checked_detections(
    frame: int, given: Sequence[Detection], camera: Camera | None, keypoint_counts: Mapping[str, int]
) -> tuple[tuple[Detection, ...], tuple[str, ...]]:
    """The detections of one frame, one a track, and what was done to them.

    Of two on one track the one of the better score stays. `keypoint_counts` says how many key points detections of a
    category have, if any. DetectionError names the frame and the detection: for one of another image size, with other
    key points than expected, with a damaged mask, or with values that are not finite.
    """
    try:
        found = tuple(given)
    except TypeError:
        raise DetectionError(f"frame {frame}: detections are {type(given).__name__}, expected Detections") from None
    for place, detection in enumerate(found):
        if not isinstance(detection, Detection):
            raise DetectionError(f"frame {frame}: detection {place} is {type(detection).__name__}, not a Detection")
        problem = _problem(detection, camera, keypoint_counts.get(detection.category, 0))
        if problem:
            raise DetectionError(f"frame {frame}: detection {detection.id!r:.20} {problem}"[:300])
    return _one_a_track(frame, tuple(_plain(d) for d in found))


def _plain(detection: Detection) -> Detection:
    """With Python's own numbers, which can be written as JSON."""
    height, width = detection.image_size
    x, y, w, h = detection.bbox
    return replace(
        detection,
        id=int(detection.id),
        score=float(detection.score),
        bbox=(float(x), float(y), float(w), float(h)),
        image_size=(int(height), int(width)),
        track_id=None if detection.track_id is None else int(detection.track_id),
    )


def _problem(detection: Detection, camera: Camera | None, keypoint_count: int) -> str | None:
    """What keeps a detection from being used, in one clause."""
    try:
        return (
            _size_problem(detection, camera)
            or _value_problem(detection)
            or _keypoint_problem(detection, keypoint_count)
        )
    except (TypeError, ValueError, AttributeError, KeyError, OverflowError) as error:
        return f"holds a value of a wrong type: {error}"


def _size_problem(detection: Detection, camera: Camera | None) -> str | None:
    height, width = detection.image_size
    if camera is not None and (height, width) != (camera.height, camera.width):
        return (
            f"is of an image of {width}x{height} px, expected the camera's {camera.width}x{camera.height} px: detect "
            "in the camera's images, or scale mask, box and key points back"
        )
    problem = segmentation_problem(detection.segmentation, int(height), int(width))
    return f"has a segmentation that {problem}" if problem else None


def _value_problem(detection: Detection) -> str | None:
    track, box = detection.track_id, np.asarray(detection.bbox, float)
    if box.shape != (4,) or not np.isfinite(box).all() or box[2:].min() < 0:
        return f"has a box of {detection.bbox!r:.80}, expected x, y, width, height in px"
    if not 0 <= detection.score <= 1:
        return f"has a score of {detection.score:.6g}, expected 0 to 1"
    if track is not None and (isinstance(track, bool) or not isinstance(track, int | np.integer)):
        return f"has track_id {track!r:.30}, expected an integer or None"
    shares = detection.viewing_angle_shares
    if shares is not None and not (np.isfinite(shares).all() and np.min(shares) >= 0):
        return "has viewing_angle_shares that are not finite numbers from 0"
    return None


def _keypoint_problem(detection: Detection, expected: int) -> str | None:
    points, scores, sigmas = detection.keypoints, detection.keypoint_scores, detection.keypoint_sigmas_px
    if points is None:
        return None
    if scores is None:
        return "has key points without keypoint_scores"
    if np.shape(points) != (len(points), 2) or np.shape(scores) != (len(points),):
        return f"has key points of shape {np.shape(points)} with scores of {np.shape(scores)}, expected (K, 2) and (K,)"
    if expected and len(points) != expected:
        return f"has {len(points)} key points, expected {expected}: one for each of keypoint_names, unseen ones score 0"
    scores = np.asarray(scores, float)
    seen = scores > 0
    if not np.isfinite(scores).all() or not np.isfinite(np.asarray(points, float)[seen]).all():
        return "has key points or scores that are not finite"
    if sigmas is not None and (np.shape(sigmas) != scores.shape or not (np.asarray(sigmas, float)[seen] > 0).all()):
        return "has keypoint_sigmas_px that are not one number above 0 for each key point"
    return None


def _one_a_track(frame: int, found: tuple[Detection, ...]) -> tuple[tuple[Detection, ...], tuple[str, ...]]:
    best: dict[int, Detection] = {}
    for detection in found:
        if detection.track_id is not None:
            other = best.get(detection.track_id)
            best[detection.track_id] = detection if other is None or detection.score > other.score else other
    kept = tuple(d for d in found if d.track_id is None or best[d.track_id] is d)
    tracks = sorted({d.track_id for d in found if d.track_id is not None and best[d.track_id] is not d})
    notes = tuple(
        f"frame {frame}: several detections on track {track}: the one of the best score stays" for track in tracks
    )
    return kept, notes
