"""The paper's localization: each pose predicted by IMU, then gradient descent on its mask and key point losses."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from meshslam.categories import keypoint_order
from meshslam.geometry import Camera, Floats, MaskLoss, Pose, geman_mcclure_soft
from meshslam.initialization import EstimationConfig
from meshslam.localization.config import LocalizationConfig
from meshslam.localization.data_association import FrameMasks, associate, in_view
from meshslam.localization.estimator import NO_OBJECT_THERE, FrameReport
from meshslam.localization.map_models import KnownMap, KnownObject
from meshslam.motion import Mounting, NavState, Preintegrator, predict, rate_at
from meshslam.objects import ObjectConfig, keypoints_of
from meshslam.perception import Detection, are_near
from meshslam.sequences import ImuSamples

_KERNEL = 3.0  # Geman and McClure's threshold for key points, in sigmas: one wild point would outweigh all masks


@dataclass(frozen=True, eq=False)
class CameraLoss:
    """L_mask + weight L_kps of one object's view over the camera's pose (paper, Eq. 4)."""

    thing: KnownObject
    mask: MaskLoss | None  # None where something hides the object: the paper's mask loss knows no occluders
    camera: Camera
    keypoints: Floats  # (k, 3), in object
    pixels: Floats  # (k, 2)
    sigma_px: Floats  # (k,)
    keypoint_weight: float

    def value(self, world_from_camera: Pose) -> tuple[float, Floats]:
        """Loss, and its gradient (6,) over a right perturbation of the camera, (translation, rotation)."""
        relative = world_from_camera.inverse() @ self.thing.world_from_object
        loss, gradient = 0.0, np.zeros(6)
        if self.mask is not None:
            found = self.mask.gradient(relative, self.thing.vertices)
            loss, gradient = found.loss, found.camera.copy()
        points = relative.transform(self.keypoints)
        for point, pixel, sigma in zip(points, self.pixels, self.sigma_px, strict=True):
            if point[2] < 0.1:
                continue
            gap = self.camera.project(point) - pixel
            squared = float(gap @ gap) / sigma**2
            soft = geman_mcclure_soft(squared, _KERNEL**2)
            weight = self.keypoint_weight / sigma**2 / soft**2
            slope = 2 * weight * self.camera.projection_jacobian(point).T @ gap
            loss += self.keypoint_weight * squared / soft
            gradient[:3] -= slope
            gradient[3:] -= np.cross(point, slope)  # a camera that turns by w moves the point by -w x point
        return loss, gradient


Value = Callable[[Pose], tuple[float, Floats]]


def descend(start: Pose, value_of: Value, scale: Floats, iterations: int) -> list[Pose]:
    """Poses after 0, 1, ... iterations: steps along the gradient whose length follows from the last (backtracking).

    `scale` (6,) are metres and radians that move the image by a pixel; a step that does not help is halved.
    """
    poses, step_px = [start], 1.0
    value, gradient = value_of(start)
    for _ in range(iterations):
        slope = scale * gradient
        size = float(np.linalg.norm(slope))
        if size < 1e-12:
            break
        for _ in range(8):
            trial = poses[-1].retract(-scale * slope / size * step_px)
            found = value_of(trial)
            if found[0] < value:
                break
            step_px *= 0.5
        else:
            break
        poses.append(trial)
        value, gradient = found
        step_px *= 1.6
    return poses


def descend_camera(start: Pose, losses: Sequence[CameraLoss], iterations: int) -> list[Pose]:
    """A camera's poses after 0, 1, ... descent steps on the sum of its observations' losses; the start if none."""
    if not losses:
        return [start]
    depth = float(np.median([max(_depth_m(start, loss.thing.world_from_object), 2.0) for loss in losses]))
    return descend(start, lambda pose: camera_value(pose, losses), per_pixel(depth, losses[0].camera.fx), iterations)


def camera_value(pose: Pose, losses: Sequence[CameraLoss]) -> tuple[float, Floats]:
    """Sum of the views' losses, and its gradient (6,) over a right perturbation of the camera."""
    parts = [loss.value(pose) for loss in losses]
    return sum(value for value, _ in parts), np.sum([gradient for _, gradient in parts], axis=0)


def per_pixel(depth_m: float, focal_px: float) -> Floats:
    """What moves the image by a pixel (6,), metres and radians, so that both move it alike."""
    return np.array([depth_m / focal_px] * 3 + [1.0 / focal_px] * 3)


def _depth_m(world_from_camera: Pose, world_from_object: Pose) -> float:
    return float(world_from_camera.inverse().transform(world_from_object.translation)[2])


def camera_loss(
    masks: FrameMasks, detection: Detection, thing: KnownObject, keypoint_names: Sequence[str], weight: float
) -> CameraLoss:
    """The loss of one detection of a known object; without its mask where another detection is near."""
    order = keypoint_order(keypoint_names, thing.keypoint_names)
    index, pixels, sigma = keypoints_of(detection, order, ObjectConfig())
    placed = thing.keypoints[index] if len(index) else np.zeros((0, 3))
    free = not any(are_near(other, detection) for other in masks.detections if other.id != detection.id)
    camera, mask = masks.camera, masks.masks[detection.id]
    seen = MaskLoss(camera, len(thing.vertices), thing.faces, mask) if free else None
    return CameraLoss(thing, seen, camera, placed, pixels, sigma, weight)


@dataclass
class GradientEstimator:
    """Frame by frame as in the paper; the same calls as `LocalizationEstimator`'s."""

    camera: Camera
    known: KnownMap
    mounting: Mounting
    keypoint_names: Mapping[str, tuple[str, ...]]
    estimation: EstimationConfig
    config: LocalizationConfig
    path: dict[int, Pose] = field(default_factory=dict)
    moved: dict[int, int] = field(default_factory=dict)  # this solver finds none
    steps: dict[int, list[Pose]] = field(default_factory=dict)  # by frame: the pose after each iteration

    def begin(self, frame: int, state: NavState, imu: ImuSamples, detections: tuple[Detection, ...]) -> FrameReport:
        """The first frame, whose state is known."""
        self._preintegrator = Preintegrator(self.estimation.imu)
        return self._update(frame, state, rate_at(imu, state.time_s), detections, has_gap=False)

    def process(self, frame: int, time_s: float, imu: ImuSamples, detections: tuple[Detection, ...]) -> FrameReport:
        """The next frame."""
        interval = self._preintegrator.between(imu, self._state.time_s, time_s, self._state)
        state = predict(self._state, interval, time_s)
        return self._update(frame, state, interval.angular_rate_rad_s, detections, has_gap=interval.has_gap)

    @property
    def camera_covariance(self) -> Floats | None:
        """None: descent gives no uncertainty."""
        return None

    @property
    def current_mounting(self) -> Mounting:
        """How the camera is mounted: as given."""
        return self.mounting

    def estimate(self) -> None:
        """None: a descent on losses knows no uncertainty."""

    def paths_by_iteration(self) -> tuple[tuple[Pose, ...], ...]:
        """The path after 0, 1, ... iterations of every frame; a frame that has converged stays."""
        most = max(len(steps) for steps in self.steps.values())
        frames = [self.steps[frame] for frame in self.path]
        return tuple(tuple(steps[min(k, len(steps) - 1)] for steps in frames) for k in range(most))

    def _update(
        self, frame: int, state: NavState, rate: Floats, detections: tuple[Detection, ...], *, has_gap: bool
    ) -> FrameReport:
        predicted = self.mounting.world_from_camera(state, rate)
        masks = FrameMasks(self.camera, detections)
        near = self.known.around(predicted.translation)
        expected = in_view(self.camera, predicted, near, self.config.association.max_distance_m)
        matched = associate(masks, predicted, expected, self.config.association)
        names, weight = self.keypoint_names, self.config.gradient_keypoint_weight
        losses = [
            camera_loss(masks, d, matched[d.id], names.get(d.category, ()), weight)
            for d in masks.detections
            if d.id in matched
        ]
        steps = descend_camera(predicted, losses, self.config.gradient_iterations)
        corrected = steps[-1]
        self.steps[frame], self.path[frame] = steps, corrected
        world_from_imu = corrected @ self.mounting.imu_from_camera.inverse()
        self._state = replace(state, world_from_imu=world_from_imu)
        ids = {k: thing.id for k, thing in matched.items()}
        reasons = {d.id: NO_OBJECT_THERE for d in detections if d.id not in matched}
        return FrameReport(frame, predicted, corrected, ids, (), has_gap, reasons)
