"""The paper's joint problem: cameras and objects descend together on the views' losses (paper, Eq. 4, Sec. IV-B)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.localization import (
    CameraLoss,
    FrameMasks,
    KnownObject,
    camera_loss,
    descend,
    descend_camera,
    known_objects,
    per_pixel,
)
from meshslam.maps import Map
from meshslam.perception import DetectionSet
from meshslam.sequences import Sequence as Recording


@dataclass
class JointDescent:
    """Cameras of all frames and the objects that they see; the first camera says where the world is.

    Given the objects the loss is a sum over cameras, given the cameras it is one over objects: an iteration takes one
    step along each one's gradient, first the cameras', then the objects'. A camera that sees none goes with the one
    before.
    """

    cameras: list[Pose]
    losses: list[list[CameraLoss]]  # of each frame
    objects: dict[int, KnownObject]
    steps: list[Pose] = field(default_factory=list)  # from each camera to the next, where nothing is seen

    def __post_init__(self) -> None:
        pairs = zip(self.cameras[:-1], self.cameras[1:], strict=True)
        self.steps = [one.inverse() @ other for one, other in pairs]

    def iterate(self) -> None:
        """One step of all."""
        for k in range(1, len(self.cameras)):
            if self.losses[k]:
                self.cameras[k] = descend_camera(self.cameras[k], self.losses[k], 1)[-1]
            else:
                self.cameras[k] = self.cameras[k - 1] @ self.steps[k - 1]
        for number, thing in self.objects.items():
            seen = [
                (c, v) for c, found in zip(self.cameras, self.losses, strict=True) for v in found if v.thing is thing
            ]
            moved = replace(thing, world_from_object=_descended(thing.world_from_object, seen))
            self.objects[number] = moved
            for found in self.losses:
                found[:] = [replace(v, thing=moved) if v.thing is thing else v for v in found]

    def loss(self) -> float:
        """Sum over all views."""
        pairs = zip(self.cameras, self.losses, strict=True)
        return sum(view.value(camera)[0] for camera, found in pairs for view in found)


def _descended(start: Pose, seen: Sequence[tuple[Pose, CameraLoss]]) -> Pose:
    """An object after one step."""
    if not seen:
        return start

    def value(world_from_object: Pose) -> tuple[float, Floats]:
        loss, slope = 0.0, np.zeros(6)
        for camera, view in seen:
            placed = replace(view, thing=replace(view.thing, world_from_object=world_from_object))
            part, by_camera = placed.value(camera)
            loss += part
            slope -= (camera.inverse() @ world_from_object).adjoint().T @ by_camera
        return loss, slope

    depths = [float(camera.inverse().transform(start.translation)[2]) for camera, _ in seen]
    return descend(start, value, per_pixel(max(float(np.median(depths)), 2.0), seen[0][1].camera.fx), 1)[-1]


def joint_descent(
    sequence: Recording,
    detections: DetectionSet,
    cameras: Sequence[Pose],
    scene: Map,
    keypoint_weight: float,
    iterations: int,
    progress: Callable[[str, int, int], None] | None = None,
) -> tuple[tuple[Pose, ...], ...]:
    """The cameras' path after 0, 1, ... iterations; objects are those of `scene`, tracks carry their numbers."""
    problem = joint_problem(sequence, detections, cameras, {o.id: o for o in known_objects(scene)}, keypoint_weight)
    paths = [tuple(problem.cameras)]
    for k in range(iterations):
        problem.iterate()
        paths.append(tuple(problem.cameras))
        if progress is not None:
            progress("descend", k + 1, iterations)
    return tuple(paths)


def joint_problem(
    sequence: Recording,
    detections: DetectionSet,
    cameras: Sequence[Pose],
    objects: Mapping[int, KnownObject],
    keypoint_weight: float,
) -> JointDescent:
    """Every detection of a track that is an object is a view."""
    names, by_frame = {c.name: c.keypoints for c in detections.categories}, detections.by_frame()
    losses = []
    for frame in sequence.frame_ids:
        masks = FrameMasks(sequence.camera, by_frame.get(frame, ()))
        shown = [(d, objects[d.track_id]) for d in masks.detections if d.track_id is not None and d.track_id in objects]
        losses.append([camera_loss(masks, d, o, names.get(d.category, ()), keypoint_weight) for d, o in shown])
    return JointDescent(list(cameras), losses, dict(objects))
