"""Key points of the vehicles in an image, by the network that the package ships."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from meshslam.categories import load_category
from meshslam.errors import ModelError
from meshslam.geometry import Bytes, Floats, Singles
from meshslam.perception.coco import VEHICLES
from meshslam.perception.detections import Detection, DetectionSet
from meshslam.perception.keypoints.crop import HEIGHT_PX, WIDTH_PX, Crop, cut_out, to_input
from meshslam.perception.keypoints.decode import (
    ANGLES,
    KEYPOINTS,
    angle_distribution,
    keypoint_scores,
    laplace_sigma,
    points_in_input,
)
from meshslam.perception.keypoints.mirror import Answers, answers_of
from meshslam.perception.onnx_runtime import inference_session
from meshslam.settings import Settings, expert, public

SHIPPED = "car_keypoints.onnx"
OUTPUTS = ("heat", "visible", "log_sigma", "angle")


@dataclass(frozen=True)
class KeypointConfig(Settings):
    """How key points are found."""

    enabled: bool = public(True, doc="find key points of cars with the shipped network, where there are images")
    model: str | None = public(None, doc="an ONNX file instead of the shipped one")
    category: str = expert("car")  # whose key points the network knows; it is asked for every vehicle
    min_box_px: float = expert(20.0, low=0)  # of the longer side; smaller cars get none
    edge_margin_px: float = expert(10.0, low=0)  # nor do those that the image's edge cuts: a part is taken for a whole
    batch: int = expert(8, low=1)
    sigma_factor: float = expert(1.0, above=0)  # real images over drawn ones
    threads: int = expert(2, low=1)


@dataclass(frozen=True, eq=False)
class CarPoints:
    """What the network says of one car."""

    pixels: Floats  # (12, 2) in the image
    scores: Floats  # (12,) that the point is seen, in one place, and front is not taken for rear
    sigmas_px: Floats  # (12,) along one axis, px of the image
    angle_shares: Floats  # (ANGLES,) of the viewing angle


class KeypointFinder:
    """The network in an ONNX Runtime session. Raises ModelError for a file that is not such a network."""

    def __init__(self, config: KeypointConfig | None = None) -> None:
        self.config = config or KeypointConfig()
        self.names = load_category(self.config.category).keypoint_names
        given = self.config.model
        self.path = Path(given) if given else Path(str(resources.files(__package__).joinpath("data", SHIPPED)))
        self._session = _session(self.path, self.config.threads)

    def find(self, image_bgr: Bytes, masks: Sequence[Bytes]) -> list[CarPoints]:
        """Key points of the cars that masks (h, w) mark in an image (h, w, 3) or (h, w); no mask may be empty."""
        crops = [Crop.around(_box(mask)) for mask in masks]
        found: list[CarPoints] = []
        for start in range(0, len(masks), self.config.batch):
            part = slice(start, start + self.config.batch)
            cuts = np.stack([cut_out(image_bgr, m, c) for m, c in zip(masks[part], crops[part], strict=True)])
            heat, visible, log_sigma, angle = answers_of(self.answers, to_input(cuts))
            points, share = points_in_input(heat)
            sigmas, shares = laplace_sigma(log_sigma), angle_distribution(angle)
            scores = keypoint_scores(share, visible, shares)
            found += [
                CarPoints(
                    crop.to_image(points[i]),
                    scores[i],
                    self.config.sigma_factor * sigmas[i] / float(crop.scale.mean()),
                    shares[i],
                )
                for i, crop in enumerate(crops[part])
            ]
        return found

    def answers(self, crops: Singles) -> Answers:
        """What the network says of inputs (N, 4, HEIGHT_PX, WIDTH_PX)."""
        return tuple(self._session.run(list(OUTPUTS), {"crops": crops}))


def add_keypoints(
    detections: DetectionSet,
    read_image: Callable[[int], Bytes],
    finder: KeypointFinder,
    progress: Callable[[int], None] | None = None,
) -> DetectionSet:
    """The detections, every vehicle with its key points; a set that has key points of vehicles stays as it is.

    `read_image` takes a frame number to its image.
    """
    if has_keypoints(detections):
        return detections
    filled: dict[int, Detection] = {}
    for frame, found in detections.by_frame().items():
        filled.update(frame_keypoints(found, partial(read_image, frame), finder))
        if progress:
            progress(frame)
    categories = tuple(replace(c, keypoints=finder.names) if c.name in VEHICLES else c for c in detections.categories)
    return replace(
        detections, categories=categories, detections=tuple(filled.get(d.id, d) for d in detections.detections)
    )


def frame_keypoints(
    detections: Sequence[Detection], read_image: Callable[[], Bytes], finder: KeypointFinder
) -> dict[int, Detection]:
    """One frame's vehicles with their key points, by id; the image is read where there are any."""
    wanted = [d for d in detections if d.category in VEHICLES and _whole(d, finder.config)]
    masks = {d.id: d.mask() for d in wanted}
    wanted = [d for d in wanted if masks[d.id].any()]
    if not wanted:
        return {}
    cars = finder.find(read_image(), [masks[d.id] for d in wanted])
    return {d.id: _with(d, car) for d, car in zip(wanted, cars, strict=True)}


def has_keypoints(detections: DetectionSet) -> bool:
    """Whether any vehicle of the set has key points."""
    return any(d.keypoints is not None for d in detections.detections if d.category in VEHICLES)


def _whole(detection: Detection, config: KeypointConfig) -> bool:
    """Whether a car is large enough and not cut at the left, right or lower edge of the image."""
    (x, y, w, h), (height, width), margin = detection.bbox, detection.image_size, config.edge_margin_px
    return max(w, h) >= config.min_box_px and x >= margin and x + w <= width - margin and y + h <= height - margin


def _with(detection: Detection, car: CarPoints) -> Detection:
    """The detection with key points, rounded as they are written; those outside of its image say nothing."""
    height, width = detection.image_size
    pixels = np.round(car.pixels, 2)
    inside = np.all((pixels >= -0.5) & (pixels <= [width - 0.5, height - 0.5]), axis=1)
    return replace(
        detection,
        keypoints=np.where(inside[:, None], pixels, 0.0),
        keypoint_scores=np.asarray(np.round(np.where(inside, car.scores, 0.0), 4), float),
        keypoint_sigmas_px=np.round(car.sigmas_px, 3),
        viewing_angle_shares=np.round(car.angle_shares, 4),
    )


def _box(mask: Bytes) -> tuple[float, float, float, float]:
    x, y, w, h = cv2.boundingRect(np.ascontiguousarray(mask))
    return float(x), float(y), float(w), float(h)


def _session(path: Path, threads: int) -> Any:  # noqa: ANN401 # untyped package
    if not path.is_file():
        raise ModelError(f"{path}: no such file, expected the key point network (meshslam train-keypoints makes one)")
    try:
        session = inference_session(path, threads)
        found = session.run(list(OUTPUTS), {"crops": np.zeros((1, 4, HEIGHT_PX, WIDTH_PX), np.float32)})
    except Exception as error:  # the runtime's own exceptions have no common base but this
        line = (str(error).strip().splitlines() or [type(error).__name__])[0][:200]
        raise ModelError(f"{path}: is no key point network: {line}") from None
    if [a.shape[1] for a in found] != [KEYPOINTS, KEYPOINTS, KEYPOINTS, ANGLES]:
        raise ModelError(f"{path}: answers have shapes {[a.shape for a in found]}, expected those of {SHIPPED}")
    return session
