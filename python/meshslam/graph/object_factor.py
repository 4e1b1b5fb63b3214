"""Factors of the graph whose cost the core computes: one call of Python a factor.

Keys: X the IMU's pose, V its velocity, B biases (GTSAM's combined factor ties these), E the rotation imu_from_camera,
T the time offset, O an object's pose, Z its modes.
"""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from dataclasses import dataclass, field

import gtsam
import numpy as np

from meshslam.geometry import Bools, Floats, NoiseModel, ObjectModel, Pose, SquareRoot, View, cross_matrix, exp_so3
from meshslam.motion import from_pose3, to_gtsam_columns

REUSE_PX = 0.2  # a linearization is kept while it moves the object on the image by less,
REUSE_MODES = 0.1  # and its modes by less

CameraKeys = tuple[int, int, int, int]  # X, V, E, T


@dataclass(frozen=True, eq=False)
class CameraPlace:
    """world_from_camera with its derivatives over (translation, rotation) of the camera."""

    pose: Pose
    by_imu: Floats  # (6, 6), over (translation, rotation) of X
    by_velocity: Floats  # (6, 3)
    by_rotation: Floats  # (6, 3), over E
    by_offset: Floats  # (6, 1), over T

    @property
    def by_variables(self) -> Floats:
        """Derivative (6, 13) over X, V, E and T, in GTSAM's tangent spaces."""
        return np.hstack([to_gtsam_columns(self.by_imu), self.by_velocity, self.by_rotation, self.by_offset])


class CameraMemo:
    """The camera of one frame at the last values asked for: all views of a frame ask for the same."""

    def __init__(self, lever_arm_m: Floats, rate_rad_s: Floats) -> None:
        self._arm, self._rate = lever_arm_m, rate_rad_s
        self._values: weakref.ref[gtsam.Values] | None = None  # nothing else is read where these are asked for again
        self._at: tuple[bytes, ...] = ()
        self._place: CameraPlace | None = None

    def place(self, values: gtsam.Values, keys: CameraKeys) -> CameraPlace:
        """The camera at these values; call `forget` when they are changed in place."""
        if self._place is not None and self._values is not None and self._values() is values:
            return self._place
        self._values = weakref.ref(values)
        x, v, e, t = keys
        pose, velocity, turn, offset = values.atPose3(x), values.atVector(v), values.atRot3(e), values.atVector(t)
        matrix, turned = pose.matrix(), turn.matrix()
        at = matrix.tobytes(), velocity.tobytes(), turned.tobytes(), offset.tobytes()
        if self._place is None or at != self._at:
            mounted = Pose(turned, self._arm)
            world_from_imu = Pose(matrix[:3, :3], matrix[:3, 3])
            self._at = at
            self._place = place_camera(world_from_imu, velocity, mounted, float(offset[0]), self._rate)
        return self._place

    def forget(self) -> None:
        """Read the values when they are asked for next, even if they are the same object."""
        self._values = None

    @property
    def last(self) -> CameraPlace:
        """The camera as it was placed last."""
        assert self._place is not None
        return self._place


def place_camera(
    world_from_imu: Pose, velocity: Floats, imu_from_camera: Pose, offset_s: float, rate_rad_s: Floats
) -> CameraPlace:
    """The camera `offset_s` after the IMU's state, and how it moves with each of them.

    R_c = R exp(w dt) R_e, p_c = p + v dt + R exp(w dt) t_e.
    """
    turn = exp_so3(rate_rad_s * offset_s)
    turned, arm = world_from_imu.rotation @ turn, turn @ imu_from_camera.translation
    rotation = turned @ imu_from_camera.rotation
    pose = Pose(rotation, world_from_imu.translation + velocity * offset_s + world_from_imu.rotation @ arm)
    camera_from_imu_now = (turn @ imu_from_camera.rotation).T
    by_imu, by_offset = np.zeros((6, 6)), np.zeros((6, 1))
    by_imu[:3, :3] = by_imu[3:, 3:] = camera_from_imu_now
    by_imu[:3, 3:] = -camera_from_imu_now @ cross_matrix(arm)
    by_velocity, by_rotation = np.zeros((6, 3)), np.zeros((6, 3))
    by_velocity[:3] = offset_s * rotation.T
    by_rotation[3:] = np.eye(3)
    swing = turned @ (cross_matrix(rate_rad_s) @ imu_from_camera.translation)
    by_offset[:3, 0] = rotation.T @ (velocity + swing)
    by_offset[3:, 0] = imu_from_camera.rotation.T @ rate_rad_s
    return CameraPlace(pose, by_imu, by_velocity, by_rotation, by_offset)


def small_rotation(turn: Floats) -> Floats:
    """Axis-angle vector (3,) of a rotation near the identity, to third order."""
    (_, a, b), (c, _, d), (e, f, _) = turn.tolist()
    return np.array([0.5 * (f - d), 0.5 * (b - e), 0.5 * (c - a)])


@dataclass
class ObservationCost:
    """The cost of one view over camera_from_object and modes; a linearization serves until its image moves."""

    model: ObjectModel
    view: View | None  # None: the last linearization serves for good
    noise: NoiseModel
    focal_px: float
    evaluations: int = 0
    _at: tuple[Pose, Floats] | None = field(default=None, repr=False)
    _root: SquareRoot | None = field(default=None, repr=False)

    def linearize(self, camera_from_object: Pose, z: Floats | None = None) -> tuple[Floats, Floats]:
        """Derivative (n + 1, n) over (translation, rotation, modes if z is given) and residual (n + 1,)."""
        weights = np.zeros(0) if z is None else z
        step = self._step(camera_from_object, weights)
        if self.view is not None and (step is None or self._root is None):
            self.evaluations += 1
            self._root = self.model.square_root(self.view, self.noise, camera_from_object, z, modes=z is not None)
            self._at = camera_from_object, weights
            step = np.zeros(6 + len(weights))
        assert step is not None
        assert self._root is not None
        jacobian = self._root.root[:, :-1]
        residual: Floats = jacobian @ step + self._root.root[:, -1]
        if self.view is None and self._at is not None:  # it may be far from here
            turned = self._at[0].rotation.T @ camera_from_object.rotation
            by_pose = along_step(jacobian[:, :6], turned)
            jacobian = np.concatenate([by_pose, jacobian[:, 6:]], axis=1)
        return jacobian, residual

    def freeze(self, camera_from_object: Pose, z: Floats) -> None:
        """Linearize here for good, and let the view go."""
        self._at = None
        self.linearize(camera_from_object, z)
        self.view = None

    @property
    def linearization(self) -> tuple[tuple[Pose, Floats] | None, SquareRoot | None]:
        """Where the cost was linearized last, and its square root there."""
        return self._at, self._root

    @linearization.setter
    def linearization(self, kept: tuple[tuple[Pose, Floats] | None, SquareRoot | None]) -> None:
        self._at, self._root = kept

    @property
    def is_new(self) -> bool:
        """Whether it has not been linearized yet."""
        return self._at is None or self._root is None

    @property
    def frozen(self) -> tuple[Pose, Floats, SquareRoot]:
        """Where the view was linearized last, and what it then said."""
        assert self._at is not None
        assert self._root is not None
        return *self._at, self._root

    def restore(self, camera_from_object: Pose, z: Floats, root: SquareRoot) -> None:
        """Take over a linearization."""
        self._at, self._root = (camera_from_object, z), root

    def cost_share(self, camera_from_object: Pose, z: Floats | None = None) -> float:
        """Cost per independent observation: about 1/2 where the model is right."""
        _, residual = self.linearize(camera_from_object, z)
        assert self._root is not None
        return 0.5 * float(residual @ residual) / max(self._root.observations, 1.0)

    def _step(self, camera_from_object: Pose, z: Floats) -> Floats | None:
        """From the last linearization to here; None if there is none, or it is too far."""
        if self._at is None:
            return None
        at, old_z = self._at
        turn = at.rotation.T @ camera_from_object.rotation
        moved = camera_from_object.translation - at.translation
        small = small_rotation(turn)
        step = np.concatenate([at.rotation.T @ moved, small, z - old_z])
        if self.view is None:
            return step
        depth = max(float(at.translation[2]), 1.0)
        # the rotation of the relative pose moves the object's surface, about 2 m off its centre
        moved_m = max(map(abs, moved.tolist())) + 2.0 * max(map(abs, small.tolist()))
        if self.focal_px * moved_m / depth > REUSE_PX or (len(z) and float(np.abs(z - old_z).max()) > REUSE_MODES):
            return None
        return step


def linearize_all(
    costs: Sequence[ObservationCost], rotations: Floats, translations: Floats, z: Floats | None
) -> tuple[Floats, Floats]:
    """As `linearize` of each of n costs: derivatives (n, w + 1, w) and residuals (n, w + 1), computed together.

    Relative poses are camera_from_object (n, 3, 3) and (n, 3), modes z (n, modes) or None for all.
    """
    roots, steps = _roots_and_steps(costs, rotations, translations, z)
    jacobians = roots[:, :, :-1]
    residuals: Floats = (jacobians @ steps[:, :, None])[:, :, 0] + roots[:, :, -1]
    frozen = [k for k, cost in enumerate(costs) if cost.view is None]
    if frozen:
        back = np.array([costs[k].frozen[0].rotation for k in frozen]).transpose(0, 2, 1)
        jacobians = jacobians.copy()
        jacobians[frozen, :, :6] = along_step(jacobians[frozen, :, :6], back @ rotations[frozen])
    return jacobians, residuals


def residuals_all(
    costs: Sequence[ObservationCost], rotations: Floats, translations: Floats, z: Floats | None
) -> Floats:
    """The residuals (n, w + 1) of `linearize_all` alone."""
    roots, steps = _roots_and_steps(costs, rotations, translations, z)
    found: Floats = (roots[:, :, :-1] @ steps[:, :, None])[:, :, 0] + roots[:, :, -1]
    return found


def along_step(jacobian: Floats, turned: Floats) -> Floats:
    """Derivatives (..., n, 6) over steps from a pose, as derivatives over the pose that a step leads to.

    `turned` (..., 3, 3) is the step's rotation T. The step's translation moves by T; its rotation, T's skew part, by
    (tr(T) I - T^T) / 2.
    """
    back = np.swapaxes(turned, -1, -2)
    by_turn = 0.5 * (np.trace(turned, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - back)
    return np.concatenate([jacobian[..., :3] @ turned, jacobian[..., 3:] @ by_turn], axis=-1)


def _roots_and_steps(
    costs: Sequence[ObservationCost], rotations: Floats, translations: Floats, z: Floats | None
) -> tuple[Floats, Floats]:
    """Square roots (n, w + 1, w + 1), linearized anew where a view has moved too far, and steps (n, w) from there."""
    _linearize_anew([k for k, cost in enumerate(costs) if cost.is_new], costs, rotations, translations, z)
    steps, is_far = _steps(costs, rotations, translations, z)
    if is_far.any():
        _linearize_anew([int(k) for k in np.flatnonzero(is_far)], costs, rotations, translations, z)
        steps[is_far] = 0.0
    return np.array([cost.frozen[2].root for cost in costs]), steps


def _linearize_anew(
    chosen: Sequence[int],
    costs: Sequence[ObservationCost],
    rotations: Floats,
    translations: Floats,
    z: Floats | None,
) -> None:
    """Linearize the chosen ones at their states, one call for all that share model and noise."""
    kinds: dict[tuple[int, int], list[int]] = {}
    for k in chosen:
        kinds.setdefault((id(costs[k].model), id(costs[k].noise)), []).append(k)
    for group in kinds.values():
        some = costs[group[0]]
        views = [view for k in group if (view := costs[k].view) is not None]
        at = None if z is None else z[group]
        roots = some.model.square_roots(views, some.noise, rotations[group], translations[group], at)
        for k, root in zip(group, roots, strict=True):
            costs[k].evaluations += 1
            costs[k].restore(Pose(rotations[k], translations[k]), np.zeros(0) if z is None else z[k], root)


def _steps(
    costs: Sequence[ObservationCost], rotations: Floats, translations: Floats, z: Floats | None
) -> tuple[Floats, Bools]:
    """Steps (n, w) from the last linearizations, and which views (n,) they move too far: as `ObservationCost._step`."""
    at = [cost.frozen for cost in costs]
    back = np.array([pose.rotation for pose, _, _ in at]).transpose(0, 2, 1)
    from_at = np.array([pose.translation for pose, _, _ in at])
    turned, moved = back @ rotations, translations - from_at
    small = 0.5 * (turned - turned.transpose(0, 2, 1))[:, [2, 0, 1], [1, 2, 0]]
    steps = [(back @ moved[:, :, None])[:, :, 0], small]
    moved_m = np.abs(moved).max(1) + 2.0 * np.abs(small).max(1)
    focal_px = np.array([cost.focal_px for cost in costs])
    is_far = focal_px * moved_m / np.maximum(from_at[:, 2], 1.0) > REUSE_PX
    if z is not None:
        changed = z - np.array([z for _, z, _ in at])
        steps.append(changed)
        is_far |= np.abs(changed).max(1, initial=0.0) > REUSE_MODES
    return np.concatenate(steps, axis=1), is_far & np.array([cost.view is not None for cost in costs])


def object_factor(
    cost: ObservationCost,
    camera_keys: CameraKeys,
    camera_memo: CameraMemo,
    world_from_object: Pose | int,
    z: int | None = None,
) -> gtsam.CustomFactor:
    """A view as a factor over the camera's keys, and over the object's pose and modes where these are keys.

    `camera_memo` is shared by the views of a frame. Without `z` the object has its model's mean shape.
    """
    pose_is_key, modes_are_key = isinstance(world_from_object, int), z is not None
    keys = list(camera_keys)
    keys += [key for key in (world_from_object, z) if isinstance(key, int)]
    rows = 7 + (cost.model.mode_count if modes_are_key else 0)

    def error(_this: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        camera = camera_memo.place(values, camera_keys)
        placed = (
            from_pose3(values.atPose3(world_from_object)) if isinstance(world_from_object, int) else world_from_object
        )
        weights = None if z is None else values.atVector(z)
        camera_from_object = camera.pose.inverse() @ placed
        by_object, residual = cost.linearize(camera_from_object, weights)
        if jacobians is not None:
            by_camera = -by_object[:, :6] @ camera_from_object.inverse().adjoint()
            jacobians[0] = to_gtsam_columns(by_camera @ camera.by_imu)
            jacobians[1] = np.asfortranarray(by_camera @ camera.by_velocity)
            jacobians[2] = np.asfortranarray(by_camera @ camera.by_rotation)
            jacobians[3] = np.asfortranarray(by_camera @ camera.by_offset)
            if pose_is_key:
                jacobians[4] = to_gtsam_columns(by_object[:, :6])
            if modes_are_key:
                jacobians[-1] = np.asfortranarray(by_object[:, 6:])
        return residual

    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(rows), keys, error)
