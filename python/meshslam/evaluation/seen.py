"""What the camera sees of true and of estimated objects, frame by frame: for measures that are taken in images."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from meshslam.evaluation.path_pairs import nearest_in_time
from meshslam.evaluation.truth import Truth
from meshslam.geometry import Pose
from meshslam.maps import Map, MapObject, Trajectory
from meshslam.perception import Detection, DetectionSet


@dataclass(frozen=True, eq=False)
class Sight:
    """One object in one frame."""

    thing: MapObject
    camera_from_object: Pose
    world_from_object: (
        Pose  # in the true world: an estimate stands where the true camera sees what the estimated one did
    )
    score: float
    height_px: float  # of the detection's box
    counts: bool


@dataclass(frozen=True, eq=False)
class SeenFrame:
    """The objects that detections show in one frame."""

    frame: int
    truths: tuple[Sight, ...]
    estimates: tuple[Sight, ...]


def seen_frames(
    truth: Truth,
    true_detections: DetectionSet,
    estimate: Map,
    detections: DetectionSet,
    estimated_path: Trajectory,
    counted: set[int],
    max_difference_s: float,
) -> list[SeenFrame]:
    """Frames of the run that have a true pose; `counted` are the true objects that are to be found.

    A true object is seen where a detection of the recording shows it (association.json), an estimated one where a
    detection of the run has its number.
    """
    if truth.objects is None or truth.path is None:
        return []
    nearest, found = nearest_in_time(estimated_path.times_s, truth.path.times_s, max_difference_s)
    given, shown = true_detections.by_frame(), detections.by_frame()
    object_of = truth.object_of_annotation or {}
    frames = []
    for index, (frame, seen) in enumerate(shown.items()):
        if not found[index]:
            continue
        true_pose, pose = truth.path.world_from_camera[nearest[index]], estimated_path.world_from_camera[index]
        of_truth = {d: object_of[d.id] for d in given.get(frame, ()) if d.id in object_of}
        of_estimate = {d: d.track_id for d in seen if d.track_id is not None}
        frames.append(
            SeenFrame(
                frame,
                _sights(truth.objects, of_truth, true_pose, true_pose, counted),
                _sights(estimate, of_estimate, pose, true_pose, set(estimate)),
            )
        )
    return frames


def _sights(
    scene: Map, number_of: Mapping[Detection, int], world_from_camera: Pose, true_from_camera: Pose, counted: set[int]
) -> tuple[Sight, ...]:
    """One sight an object: that of its surest detection."""
    best: dict[int, Detection] = {}
    for detection, number in number_of.items():
        if number in scene and (number not in best or detection.score > best[number].score):
            best[number] = detection
    camera_from_world = world_from_camera.inverse()
    found = []
    for number, detection in sorted(best.items()):
        camera_from_object = camera_from_world @ scene[number].world_from_object
        placed = true_from_camera @ camera_from_object
        found.append(
            Sight(scene[number], camera_from_object, placed, detection.score, detection.bbox[3], number in counted)
        )
    return tuple(found)
