"""What there is to measure: a run's results, the truth, and why a part of them is missing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TypeVar

import numpy as np

from meshslam.errors import MapError
from meshslam.evaluation.objects import ObjectScores, counted_objects, match_objects, score_objects
from meshslam.evaluation.path_pairs import TIME_TOLERANCE_S, PathPair, pair_paths, positions, rotations, umeyama
from meshslam.evaluation.seen import SeenFrame, seen_frames
from meshslam.evaluation.surfaces import SurfaceDistances, surface_distances
from meshslam.evaluation.tracks import TrackDrive, track_drive
from meshslam.evaluation.truth import Truth
from meshslam.geometry import Floats, Pose
from meshslam.maps import Map, MapObject, Trajectory, TrajectoryEstimate
from meshslam.perception import DetectionSet
from meshslam.sequences import Progress

Part = TypeVar("Part")


class MaterialParts:
    """What parts are called, in `Material.missing` and in reasons."""

    MAP = "map"
    PATH = "trajectory"
    ESTIMATE = "trajectory with covariances"
    DETECTIONS = "detections"
    TRUE_OBJECTS = "true objects"
    TRUE_PATH = "true path"
    ASSOCIATION = "association of detections"
    TRUE_DETECTIONS = "detections of the recording"


class UnavailableError(MapError):
    """A protocol cannot be computed; the message is the reason."""


@dataclass(frozen=True)
class Options:
    """How protocols measure."""

    max_difference_s: float = TIME_TOLERANCE_S  # between the times of a true and an estimated pose
    rpe_frames: int = 1
    rpe_metres: float = 10.0


@dataclass
class _Kept:
    """What several protocols need is computed once."""

    scores: ObjectScores | None = None
    surfaces: list[SurfaceDistances] | None = None


@dataclass(frozen=True, eq=False)
class Material:
    """A run and its truth, as far as there are files; `missing` says of a part that is not there, why."""

    truth: Truth
    map: Map | None = None
    path: Trajectory | None = None
    path_estimate: TrajectoryEstimate | None = None
    detections: DetectionSet | None = None
    true_detections: DetectionSet | None = None
    run_folder: Path | None = None
    given_poses: str | None = None  # where the true path is what the run took as given, and so no truth to it
    options: Options = field(default_factory=Options)
    missing: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    _kept: _Kept = field(default_factory=_Kept, init=False, repr=False)

    def aligned(self) -> Material:
        """The same with map and path laid on the truth by the paths' poses (SE(3)).

        Poses count by their centres and by points 1 m along their axes, since a straight path alone leaves the roll
        about it free.
        """
        pair = self._pair
        moved = umeyama(_ends(pair.truth), _ends(pair.estimate), with_scale=False).rigid()
        path, estimate, scene = self.path, self.path_estimate, self.map
        return replace(
            self,
            path=None if path is None else Trajectory(path.times_s, tuple(moved @ p for p in path.world_from_camera)),
            path_estimate=None if estimate is None else estimate.moved(moved),
            map=None if scene is None else Map(tuple(_moved(thing, moved) for thing in scene.objects)),
        )

    def pair(self) -> PathPair:
        """True and estimated poses of one time; UnavailableError where there is none, or they are not independent."""
        if self.given_poses is not None:
            raise UnavailableError(self.given_poses)
        return self._pair

    @cached_property
    def _pair(self) -> PathPair:
        truth, path = self.true_path(), self._there(MaterialParts.PATH, self.path)
        pair = pair_paths(truth, path, self.options.max_difference_s)
        if not len(pair):
            spans = [f"{p.times_s[0]:.3f} to {p.times_s[-1]:.3f} s" for p in (truth, path)]
            raise UnavailableError(
                f"no estimated pose is within {self.options.max_difference_s:g} s of a true one: truth {spans[0]}, "
                f"estimate {spans[1]}: another clock? --max-difference allows more"
            )
        return pair

    def true_path(self) -> Trajectory:
        """The true path, or UnavailableError."""
        return self._there(MaterialParts.TRUE_PATH, self.truth.path)

    def estimate(self) -> TrajectoryEstimate:
        """The trajectory with covariances, or UnavailableError."""
        return self._there(MaterialParts.ESTIMATE, self.path_estimate)

    def pairs(self) -> list[tuple[MapObject, MapObject]]:
        """Matched objects (true, estimated), of those that count."""
        true, scene = (
            self._there(MaterialParts.TRUE_OBJECTS, self.truth.objects),
            self._there(MaterialParts.MAP, self.map),
        )
        counted = counted_objects(self.truth)
        return [pair for pair in match_objects(true, scene) if pair[0].id in counted]

    def object_scores(self, progress: Progress) -> ObjectScores:
        """Scores of the objects, which are taken once."""
        self._there(MaterialParts.TRUE_OBJECTS, self.truth.objects)
        scene = self._there(MaterialParts.MAP, self.map)
        if self._kept.scores is None:
            self._kept.scores = score_objects(self.truth, scene, progress)
        if self._kept.scores is None:
            raise UnavailableError("no true object counts")
        return self._kept.scores

    def surfaces(self, progress: Progress) -> list[SurfaceDistances]:
        """Distances of the surfaces of matched objects, in the true object's frame, which are taken once."""
        if self._kept.surfaces is None:
            found, pairs = [], self.pairs()
            for done, (true, estimate) in enumerate(pairs, 1):
                moved = true.world_from_object.inverse() @ estimate.world_from_object
                placed = moved.transform(estimate.vertices)
                found.append(surface_distances(true.vertices, true.faces, placed, estimate.faces))
                progress("surfaces", done, len(pairs))
            self._kept.surfaces = found
        return self._kept.surfaces

    def seen(self) -> list[SeenFrame]:
        """Objects as the camera sees them, frame by frame."""
        self._there(MaterialParts.TRUE_OBJECTS, self.truth.objects)
        self._there(MaterialParts.ASSOCIATION, self.truth.object_of_annotation)
        self.true_path()
        frames = seen_frames(
            self.truth,
            self._there(MaterialParts.TRUE_DETECTIONS, self.true_detections),
            self._there(MaterialParts.MAP, self.map),
            self._there(MaterialParts.DETECTIONS, self.detections),
            self._path_of_frames(),
            counted_objects(self.truth),
            self.options.max_difference_s,
        )
        if not any(t.counts for f in frames for t in f.truths):
            raise UnavailableError("no frame with a true pose shows a true object")
        return frames

    def tracks(self) -> TrackDrive:
        """True and estimated tracks."""
        drive = track_drive(
            self._there(MaterialParts.TRUE_DETECTIONS, self.true_detections),
            self._there(MaterialParts.ASSOCIATION, self.truth.object_of_annotation),
            self._there(MaterialParts.DETECTIONS, self.detections),
        )
        if not drive.true_boxes:
            raise UnavailableError("no true object is in a frame of the run")
        return drive

    def mask_folder(self) -> Path:
        """The run's folder, where it has all that its masks are compared with."""
        for what, part in (
            (MaterialParts.MAP, self.map),
            (MaterialParts.PATH, self.path),
            (MaterialParts.DETECTIONS, self.detections),
        ):
            self._there(what, part)
        folder = self._there("run", self.run_folder)
        if not (folder / "camera.yaml").is_file():
            raise UnavailableError(f"{folder / 'camera.yaml'}: no such file")
        return folder

    def _path_of_frames(self) -> Trajectory:
        path, images = (
            self._there(MaterialParts.PATH, self.path),
            self._there(MaterialParts.DETECTIONS, self.detections).images,
        )
        if len(path) != len(images):
            raise UnavailableError(f"the trajectory has {len(path)} poses, detections.json {len(images)} images")
        return path

    def _there(self, what: str, part: Part | None) -> Part:
        if part is None:
            raise UnavailableError(self.missing.get(what, f"there is no {what}"))
        return part


def _ends(poses: tuple[Pose, ...]) -> Floats:
    centres, turns = positions(poses), rotations(poses)
    return np.concatenate([centres, *(centres + turns[:, :, k] for k in range(3))])


def _moved(thing: MapObject, moved: Pose) -> MapObject:
    return replace(thing, world_from_object=moved @ thing.world_from_object)
