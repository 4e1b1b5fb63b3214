"""What every loader hands over: frames of one camera on one clock, with whatever is known about them."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Sequence as Items
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from meshslam.errors import SequenceError
from meshslam.geometry import Bytes, Camera, Floats, Pose
from meshslam.sequences.distortion import Distortion
from meshslam.sequences.image_source import ImageFiles, ImageSource, KeptImages
from meshslam.sequences.pose_matching import all_or_some


@dataclass(frozen=True, eq=False)
class ImuSamples:
    """Readings in the imu frame; at rest the specific force points up with 9.81 m/s².

    >>> import numpy as np
    >>> imu = ImuSamples(np.array([0.0, 0.1, 0.2]), np.zeros((3, 3)), np.tile([0.0, 0.0, 9.81], (3, 1)))
    >>> imu.rate_hz, imu.between(0.0, 0.15).times_s
    (10.0, array([0.1]))
    """

    times_s: Floats  # (n,), increasing
    angular_rate_rad_s: Floats  # (n, 3)
    specific_force_m_s2: Floats  # (n, 3)

    @property
    def rate_hz(self) -> float:
        """Samples a second over the whole recording; 0 for fewer than two, or where all have one time."""
        span_s = float(self.times_s[-1] - self.times_s[0]) if len(self.times_s) > 1 else 0.0
        return (len(self.times_s) - 1) / span_s if span_s > 0 else 0.0

    def between(self, after_s: float, until_s: float) -> ImuSamples:
        """The samples with after_s < time <= until_s, seconds: what a stream brings from one frame to the next."""
        new = (self.times_s > after_s) & (self.times_s <= until_s)
        return ImuSamples(self.times_s[new], self.angular_rate_rad_s[new], self.specific_force_m_s2[new])


@dataclass(frozen=True, eq=False)
class InitialState:
    """Where inertial odometry starts when no poses are known."""

    time_s: float
    world_from_camera: Pose
    velocity_in_world: Floats  # (3,), m/s, of the camera


class RecordingIndex(Protocol):
    """What was found by reading a recording through."""

    def save(self, path: Path) -> None:
        """Write it, so that `kept_index` need not read the recording through again; MapError if the disk is full."""


@dataclass(frozen=True, eq=False)
class Sequence:
    """Frames of one pinhole camera.

    An index counts frames; `frame_ids[index]` is the frame's number in file names and detections.
    """

    name: str
    layout: str
    root: Path
    camera: Camera  # undistorted
    frame_ids: tuple[int, ...]
    times_s: Floats  # (n,), increasing
    images: ImageSource | None = None
    world_from_camera: tuple[Pose, ...] | None = None  # known poses that the system may use
    is_levelled: bool = True  # the world's z is against gravity, not just up in the first camera
    detections_path: Path | None = None
    imu: ImuSamples | None = None
    imu_from_camera: Pose | None = None
    initial_state: InitialState | None = None
    height_above_ground_m: float | None = None
    distortion: Distortion | None = None  # of the raw images and detections; None: they are pinhole already
    partial_poses: Mapping[int, Pose] | None = None  # world_from_camera by index, where only some frames have one
    left_out_frames: frozenset[int] = frozenset()  # numbers of frames that the recording has, but not this part of it
    left_out_images: frozenset[str] = frozenset()  # names of their images
    notes: tuple[str, ...] = ()  # what reading found and could handle
    index: RecordingIndex | None = None  # where things lie in files that are long to read through

    def __post_init__(self) -> None:
        for what in ("times_s", "images", "world_from_camera"):
            value = getattr(self, what)
            if value is not None and len(value) != len(self.frame_ids):
                raise SequenceError(f"{self.root}: {len(self.frame_ids)} frames but {len(value)} {what}")

    def __len__(self) -> int:
        return len(self.frame_ids)

    @property
    def image_paths(self) -> tuple[Path, ...] | None:
        """The images' files, where they are files of their own."""
        source = self.images.source if isinstance(self.images, KeptImages) else self.images
        return source.paths if isinstance(source, ImageFiles) else None

    def with_kept_images(self, max_bytes: int) -> Sequence:
        """The same, decoding each image once while all of them need no more bytes."""
        return self if self.images is None else replace(self, images=KeptImages(self.images, max_bytes))

    def with_poses_only(self) -> Sequence:
        """The frames whose pose is known; the sequence itself where all have one or none has."""
        return self if self.partial_poses is None else self.part(sorted(self.partial_poses))

    def part(self, indices: Items[int]) -> Sequence:
        """Some of the frames, in increasing order; detections of the others are left out."""
        kept = list(indices)
        poses = dict(enumerate(self.world_from_camera or ())) or dict(self.partial_poses or {})
        known = {i: poses[k] for i, k in enumerate(kept) if k in poses}
        every, some = all_or_some(known, len(kept))
        names = () if self.images is None else self.images.names
        return replace(
            self,
            frame_ids=tuple(self.frame_ids[i] for i in kept),
            times_s=self.times_s[kept],
            images=None if self.images is None else self.images.part(kept),
            world_from_camera=every,
            partial_poses=some,
            left_out_frames=self.left_out_frames | (set(self.frame_ids) - {self.frame_ids[i] for i in kept}),
            left_out_images=self.left_out_images | (set(names) - {names[i] for i in kept if i < len(names)}),
        )

    @property
    def raw_camera(self) -> Camera:
        """The camera of the files on disk, before its distortion is taken out."""
        return self.camera if self.distortion is None else self.distortion.raw_camera

    def read_image(self, index: int) -> Bytes:
        """Return frame `index` undistorted, BGR (h, w, 3).

        SequenceError if its file is missing, damaged or of another size.
        """
        if self.images is None:
            raise SequenceError(f"{self.root}: the sequence has no images, only detections")
        raw = self.raw_camera
        image = self.images.read(index, (raw.width, raw.height))
        return image if self.distortion is None else self.distortion.undistort_image(image)
