"""From images to tracked detections, frame by frame: segmentation, key points, tracking."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.errors import ConfigError, DetectionError, GeometryError
from meshslam.geometry import Bytes, Camera, Floats
from meshslam.perception.class_names import our_names
from meshslam.perception.coco import VEHICLES
from meshslam.perception.colour import COLOUR, ColourSegmenter
from meshslam.perception.detections import Detection
from meshslam.perception.given_detections import checked_detections
from meshslam.perception.instances import Segmenter, SegmenterConfig
from meshslam.perception.keypoints.finder import KeypointConfig, KeypointFinder, frame_keypoints
from meshslam.perception.model_store import find_model
from meshslam.perception.online_tracking import OnlineTracker
from meshslam.perception.segmentation import load_segmenter, segment_frame
from meshslam.perception.tracking import TrackerConfig


class FramePerception:
    """What a frame's image shows, or what is given of it, on tracks."""

    def __init__(
        self,
        segmenter: Segmenter | Path | str | None,
        segmentation: SegmenterConfig,
        keypoints: KeypointConfig,
        tracking: TrackerConfig,
        camera: Camera | None = None,
        keypoint_counts: Mapping[str, int] | None = None,
        adapter: Path | str | None = None,
        classes: Mapping[str, str] | None = None,
    ) -> None:
        """`segmenter` is a network's file, its name in the store, `colour` for a simulated world, or any Segmenter.

        A network is loaded when it is first needed. `adapter` is a YAML file that says how it is fed and read,
        `classes` are our names of its classes by its own; ConfigError if they are given with another segmenter. Images
        are to be of the `camera`'s size, where it is given; `keypoint_counts` says how many key points given detections
        of a category have.
        """
        self._camera, self._counts = camera, keypoint_counts or {}
        self.notes: tuple[str, ...] = ()  # of the newest frame
        self._given, self._segmentation, self._keypoints = segmenter, segmentation, keypoints
        self._adapter, self._renamed = None if adapter is None else Path(adapter), our_names(classes)
        _check_network_options(segmenter, self._adapter, self._renamed)
        self._tracker, self._categories = OnlineTracker(tracking), tracking.categories
        self._segmenter: Segmenter | None = None
        self._finder: KeypointFinder | None = None
        self._next_id = 1

    def process(
        self,
        frame: int,
        image_bgr: Bytes | None,
        detections: Sequence[Detection] | None = None,
        turn: Floats | None = None,
    ) -> tuple[Detection, ...]:
        """Detections of the next frame, with tracks: those that are given, else those of the image (h, w, 3).

        Given detections that have no key points get them where there is an image, and tracks where they have none.
        `turn` (3, 3) is the homography of far points from the last frame to this one. DetectionError where there is
        neither image nor detections, or where a given one cannot be used (`checked_detections`); GeometryError for an
        image of another type or shape.
        """
        self.notes = ()
        if image_bgr is not None:
            self.check(frame, image_bgr)
        if detections is None:
            detections = self._segmented(frame, image_bgr)
        else:
            detections, self.notes = checked_detections(frame, detections, self._camera, self._counts)
        if image_bgr is not None:
            detections = self._with_keypoints(detections, image_bgr)
        if all(d.track_id is not None for d in detections if d.category in self._categories) and detections:
            return tuple(detections)
        return self._tracker.process(detections, image_bgr, turn)

    def check(self, frame: int, image: Bytes) -> None:
        """GeometryError unless an image is uint8 (h, w, 3), of the camera's size where it is known."""
        found = f"{type(image).__name__} {getattr(image, 'dtype', '')} {np.shape(image)}"
        size = "(h, w" if self._camera is None else f"({self._camera.height}, {self._camera.width}"
        is_colour = isinstance(image, np.ndarray) and image.dtype == np.uint8 and image.shape[2:] == (3,)
        if is_colour and (self._camera is None or image.shape[:2] == (self._camera.height, self._camera.width)):
            return
        raise GeometryError(f"frame {frame}: an image is uint8 BGR {size}, 3), found {found}")

    def _segmented(self, frame: int, image_bgr: Bytes | None) -> list[Detection]:
        if image_bgr is None:
            raise DetectionError(f"frame {frame}: neither an image nor detections: give image=… or detections=…")
        if self._segmenter is None:
            self._segmenter = self._loaded()
            self.notes = tuple(getattr(self._segmenter, "notes", ()))
        found = segment_frame(frame, image_bgr, self._segmenter, self._next_id)
        self._next_id += len(found)
        return found

    def _with_keypoints(self, detections: Sequence[Detection], image_bgr: Bytes) -> Sequence[Detection]:
        vehicles = [d for d in detections if d.category in VEHICLES]
        if not self._keypoints.enabled or not vehicles or any(d.keypoints is not None for d in vehicles):
            return detections
        if self._finder is None:
            self._finder = KeypointFinder(self._keypoints)
        filled = frame_keypoints(detections, lambda: image_bgr, self._finder)
        return [filled.get(d.id, d) for d in detections]

    def _loaded(self) -> Segmenter:
        given = self._given
        if given is not None and not isinstance(given, str | Path):
            return given
        if given == COLOUR:
            return ColourSegmenter()
        network = find_model(None if given is None else str(given))
        return load_segmenter(
            network, self._segmentation, adapter=self._adapter, renamed=self._renamed, tracked=self._categories
        )

    def __getstate__(self) -> dict[str, Any]:
        """For copies and pickles: networks are loaded again when they are needed."""
        return vars(self) | {"_segmenter": None, "_finder": None}

    def to_arrays(self) -> dict[str, Any]:
        """All that is held, as plain arrays."""
        return {"next_id": self._next_id, **self._tracker.to_arrays()}

    def fill(self, arrays: Mapping[str, Any]) -> None:
        """The reverse of `to_arrays`."""
        self._next_id = int(arrays["next_id"])
        self._tracker.fill(arrays)


def _check_network_options(
    segmenter: Segmenter | Path | str | None, adapter: Path | None, renamed: Mapping[str, str]
) -> None:
    is_network = segmenter is None or (isinstance(segmenter, str | Path) and segmenter != COLOUR)
    if not is_network and (adapter is not None or renamed):
        name = "adapter" if adapter is not None else "classes"
        raise ConfigError(f"{name}: the segmenter is no file of a network, which alone has it: leave it out")
