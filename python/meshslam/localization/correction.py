"""One frame's camera pose from all objects in view, and which views do not agree with it (paper, Sec. IV-D)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.graph import ObservationCost, small_rotation

_ITERATIONS = 6
_HALVINGS = 3


@dataclass(frozen=True, eq=False)
class MapObservation:
    """A view of an object whose place is known, exactly or with a covariance (6, 6) of (translation, rotation)."""

    cost: ObservationCost
    world_from_object: Pose
    covariance: Floats | None = None


@dataclass(frozen=True, eq=False)
class Correction:
    """The corrected pose, and the cost of each view there, per independent observation."""

    world_from_camera: Pose
    cost_shares: dict[int, float]


def correct(predicted: Pose, covariance: Floats, observations: Mapping[int, MapObservation]) -> Correction:
    """Lower the views' costs and the distance from the predicted pose, by Gauss-Newton with halved steps.

    `covariance` (6, 6) is the predicted pose's, of (translation, rotation). Objects with a covariance move along.
    """
    problem = _Problem(predicted, np.asarray(np.linalg.inv(covariance), float), observations)
    state = _State(predicted, {k: s.world_from_object for k, s in observations.items()})
    cost, hessian, gradient = problem.linearize(state)
    for _ in range(_ITERATIONS):
        step: Floats = -np.asarray(np.linalg.solve(hessian, gradient), float)
        for _ in range(_HALVINGS):
            trial = problem.moved(state, step)
            found = problem.linearize(trial)
            if found[0] < cost:
                break
            step *= 0.5
        else:
            break
        gain, state, (cost, hessian, gradient) = cost - found[0], trial, found
        if gain < 1e-2:
            break
    shares = {k: s.cost.cost_share(state.camera.inverse() @ state.objects[k]) for k, s in observations.items()}
    return Correction(state.camera, shares)


@dataclass(frozen=True, eq=False)
class _State:
    camera: Pose
    objects: dict[int, Pose]


class _Problem:
    def __init__(self, predicted: Pose, information: Floats, observations: Mapping[int, MapObservation]) -> None:
        self.predicted, self.information, self.observations = predicted, information, observations
        free = [k for k, s in observations.items() if s.covariance is not None]
        self.column = {k: 6 + 6 * i for i, k in enumerate(free)}
        self.size = 6 + 6 * len(free)
        self.object_information = {
            k: np.asarray(np.linalg.inv(s.covariance), float)
            for k, s in observations.items()
            if s.covariance is not None
        }

    def linearize(self, state: _State) -> tuple[float, Floats, Floats]:
        hessian, gradient = np.zeros((self.size, self.size)), np.zeros(self.size)
        cost = _add_prior(hessian, gradient, 0, self.information, self.predicted, state.camera)
        for k, observation in self.observations.items():
            relative = state.camera.inverse() @ state.objects[k]
            by_object, residual = observation.cost.linearize(relative)
            by_camera = -by_object @ relative.inverse().adjoint()
            cost += 0.5 * float(residual @ residual)
            hessian[:6, :6] += by_camera.T @ by_camera
            gradient[:6] += by_camera.T @ residual
            at = self.column.get(k)
            if at is None:
                continue
            block, cross = slice(at, at + 6), by_camera.T @ by_object
            hessian[block, block] += by_object.T @ by_object
            hessian[:6, block] += cross
            hessian[block, :6] += cross.T
            gradient[block] += by_object.T @ residual
            prior = self.object_information[k]
            cost += _add_prior(hessian, gradient, at, prior, observation.world_from_object, state.objects[k])
        return cost, hessian, gradient

    def moved(self, state: _State, step: Floats) -> _State:
        objects = {
            k: pose.retract(step[self.column[k] : self.column[k] + 6]) if k in self.column else pose
            for k, pose in state.objects.items()
        }
        return _State(state.camera.retract(step[:6]), objects)


def _add_prior(hessian: Floats, gradient: Floats, at: int, information: Floats, mean: Pose, pose: Pose) -> float:
    """Half a squared Mahalanobis distance from a mean; the derivative of the logarithm is taken as 1."""
    small = small_rotation(mean.rotation.T @ pose.rotation)
    away = np.concatenate([pose.rotation.T @ (pose.translation - mean.translation), small])
    block = slice(at, at + 6)
    hessian[block, block] += information
    gradient[block] += information @ away
    return 0.5 * float(away @ information @ away)
