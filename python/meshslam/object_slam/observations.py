"""A frame's tracked detections as observations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from meshslam.categories import Category, keypoint_order
from meshslam.geometry import Bytes, Camera, ObjectModel, Pose, View
from meshslam.objects import FrameOcclusion, ObjectConfig, make_view
from meshslam.perception import Detection


@dataclass(frozen=True, eq=False)
class TrackObservation:
    """A detection of a track, in a frame that the smoother holds, ready for the solver."""

    index: int  # of the frame
    detection: Detection
    occluder: Bytes
    view: View


@dataclass(frozen=True, eq=False)
class ObservationMaker:
    """Makes observations of the detections of one category."""

    camera: Camera
    category: Category
    model: ObjectModel
    keypoint_names: tuple[str, ...]
    config: ObjectConfig

    def of_frame(self, index: int, detections: Sequence[Detection]) -> list[TrackObservation]:
        """Observations of a frame's tracked detections; the masks' lowest rows tell who hides whom."""
        masks = {d.id: d.mask() for d in detections}
        hidden = FrameOcclusion(self.camera, detections, lambda d: masks[d.id])
        own = [d for d in detections if d.category == self.category.name and d.track_id is not None]
        return [self.of(index, d, hidden.occluder(d), masks[d.id]) for d in own]

    def of(
        self, index: int, detection: Detection, occluder: Bytes, mask_in_image: Bytes | None = None
    ) -> TrackObservation:
        """The observation of one detection; its mask (h, w) is unpacked where it is not at hand."""
        order = keypoint_order(self.keypoint_names, self.category.keypoint_names)
        model, camera, config = self.model, self.camera, self.config
        view = make_view(model, camera, Pose.identity(), 0.0, detection, occluder, order, config, mask_in_image)
        return TrackObservation(index, detection, occluder, view)
