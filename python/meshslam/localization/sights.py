"""A frame's tracked detections as views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from meshslam.categories import Category
from meshslam.geometry import Camera, ObjectModel, Pose, View
from meshslam.geometry.arrays import Bytes
from meshslam.localization.frame_masks import lowest, touch
from meshslam.mapping.config import MappingConfig
from meshslam.mapping.observations import make_view
from meshslam.perception import Detection


@dataclass(frozen=True, eq=False)
class Sight:
    """A detection of a track in a frame that the smoother holds."""

    index: int  # of the frame
    detection: Detection
    occluder: Bytes
    view: View


@dataclass(frozen=True, eq=False)
class SightFinder:
    """Makes views of the detections of one category."""

    camera: Camera
    category: Category
    model: ObjectModel
    keypoint_names: tuple[str, ...]
    config: MappingConfig

    def of_frame(self, index: int, detections: Sequence[Detection]) -> list[Sight]:
        """Sights of a frame's tracked detections; what hides them is told by the masks' lowest rows."""
        own = [d for d in detections if d.category == self.category.name and d.track_id is not None]
        masks = {d.id: d.mask() for d in detections}
        found = []
        for detection in own:
            occluder = np.zeros((self.camera.height, self.camera.width), np.uint8)
            for other in detections:
                if other.id != detection.id and touch(other.bbox, detection.bbox) and lowest(other) > lowest(detection):
                    occluder |= masks[other.id]
            found.append(self.of(index, detection, occluder))
        return found

    def of(self, index: int, detection: Detection, occluder: Bytes) -> Sight:
        """A detection in a frame, with what it shows."""
        names = self.category.keypoint_names
        order = [names.index(n) if n in names else -1 for n in self.keypoint_names]
        view = make_view(self.model, self.camera, Pose.identity(), 0.0, detection, occluder, order, self.config)
        return Sight(index, detection, occluder, view)
