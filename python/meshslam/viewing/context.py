"""What a report shows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

from meshslam.errors import GeometryError
from meshslam.geometry import Bytes, Camera, Floats, Ints, Pose
from meshslam.maps import Map
from meshslam.perception import Detection, DetectionSet

ReadImage = Callable[[int], Bytes]  # index of a frame to its BGR image (h, w, 3)
FRAMES_IN_REPORT = 300  # frames of a run with images that its report shows


@dataclass(frozen=True, eq=False)
class TrueObject:
    """An object as it truly is, and how far the estimate that is matched to it is from it."""

    id: int
    world_from_object: Pose
    vertices: Floats  # (V, 3), in object, metres
    faces: Ints  # (F, 3)
    estimated_id: int | None = None  # None: the map does not have it
    centre_error_m: float | None = None
    yaw_error_deg: float | None = None
    voxel_iou: float | None = None


@dataclass(frozen=True, eq=False)
class ReportContext:
    """A finished run: everything that `write_report` draws.

    An index counts frames; `frame_ids[index]` is the frame's number in `detections`.
    """

    title: str
    camera: Camera
    frame_ids: tuple[int, ...]
    world_from_camera: tuple[Pose, ...]
    times_s: Floats  # (n,)
    detections: DetectionSet
    map: Map
    read_image: ReadImage | None = None  # None: meshes and masks on a drawn ground
    left_out: tuple[tuple[int, str, str], ...] = ()  # track, reason, detail
    notes: tuple[str, ...] = ()  # what the run told its user
    metrics: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    other_paths: Mapping[str, tuple[Pose, ...]] = field(default_factory=lambda: MappingProxyType({}))  # by name
    stages: Mapping[int, tuple[Pose, Floats]] | None = None  # by object: first pose and the category's mean vertices
    covariances: Floats | None = None  # (n, 6, 6) of world_from_camera, right perturbation, (translation, rotation)
    true_objects: tuple[TrueObject, ...] = ()
    path_errors: Mapping[str, Floats] = field(default_factory=lambda: MappingProxyType({}))  # see `runs.truth`
    frames_in_report: int = FRAMES_IN_REPORT  # with images; without them all frames are shown
    progress: Callable[[int, int], None] | None = None  # frames that are drawn, of how many

    def __post_init__(self) -> None:
        if len(self.frame_ids) != len(self.world_from_camera):
            raise GeometryError(
                f"a report has one pose a frame, found {len(self.world_from_camera)} for {len(self.frame_ids)} frames"
            )

    @cached_property
    def detections_by_frame(self) -> dict[int, tuple[Detection, ...]]:
        """Detections by frame number."""
        return self.detections.by_frame()

    @cached_property
    def mapped_ids(self) -> frozenset[int]:
        """Numbers of the objects in the map."""
        return frozenset(thing.id for thing in self.map.objects)

    def found_at(self, index: int) -> tuple[Detection, ...]:
        """The detections of frame `index`."""
        return self.detections_by_frame.get(self.frame_ids[index], ())
