"""A pose graph over drives: where each drive's world lies, by the objects that several drives saw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import D, O

from meshslam.geometry import Floats, Pose
from meshslam.motion import from_pose3, to_gtsam_covariance, to_pose3

_HELD = 1e-6  # m, rad, of the drive whose world is the common one
_FREE_M, _FREE_RAD = 1e3, 1e2  # of what a prior does not hold
_ROBUST = 3.0  # sigmas (Cauchy): an object that was moved meanwhile must not bend the rest
_ITERATIONS = 100


@dataclass(frozen=True, eq=False)
class ObjectInDrive:
    """An object as one drive saw it; `number` is the object's, the same in every drive."""

    drive: int
    number: int
    drive_from_object: Pose
    covariance: Floats  # (6, 6), of a right perturbation, (translation, rotation), m and rad


@dataclass(frozen=True, eq=False)
class DrivePrior:
    """What is known of a drive's world beside its objects: standard deviations about a pose, along its own axes."""

    world_from_drive: Pose
    horizontal_m: float | None = None  # None: not known
    vertical_m: float | None = None
    tilt_rad: float | None = None
    yaw_rad: float | None = None

    def sigmas(self) -> Floats:
        """(6,): rotation, then translation, as GTSAM has them."""
        tilt, yaw = self.tilt_rad or _FREE_RAD, self.yaw_rad or _FREE_RAD
        across, up = self.horizontal_m or _FREE_M, self.vertical_m or _FREE_M
        return np.array([tilt, tilt, yaw, across, across, up])


@dataclass(frozen=True, eq=False)
class LaidDrives:
    """The drives' worlds and the objects in the common one."""

    world_from_drive: dict[int, Pose]
    covariances: Floats  # (6 d, 6 d), joint, of right perturbations, drives ascending
    world_from_object: dict[int, Pose]
    object_covariances: dict[int, Floats]  # (6, 6)
    residuals: dict[tuple[int, int], Floats]  # (6,), by drive and object: from the common object to the drive's own
    errors: dict[tuple[int, int], float]  # squared Mahalanobis distance of these

    def covariance(self, one: int, other: int) -> Floats:
        """The block (6, 6) of two drives, or of one."""
        order = sorted(self.world_from_drive)
        i, j = 6 * order.index(one), 6 * order.index(other)
        found: Floats = self.covariances[i : i + 6, j : j + 6]
        return found

    def inflated(self, factor: float) -> LaidDrives:
        """The same, all covariances times a factor."""
        own = {number: factor * covariance for number, covariance in self.object_covariances.items()}
        return replace(self, covariances=factor * self.covariances, object_covariances=own)


def lay_drives(
    observations: Sequence[ObjectInDrive], priors: Mapping[int, DrivePrior], anchor: int, starts: Mapping[int, Pose]
) -> LaidDrives:
    """Lay drives into the world of `anchor`, robustly: drives and objects are variables, each observation a factor.

    `starts` are rough `world_from_drive`; `priors` say what else is known of a drive.

    Example:
        laid = lay_drives(observations, {1: DrivePrior(rough, tilt_rad=0.01)}, 0, {0: Pose.identity(), 1: rough})

    """
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for drive in sorted(starts):
        values.insert(D(drive), to_pose3(starts[drive]))
        known = None if drive == anchor else priors.get(drive, DrivePrior(starts[drive]))
        graph.push_back(_prior(drive, starts[drive], known))
    ordered = sorted(observations, key=lambda o: (o.drive, o.number))
    for seen in ordered:
        if not values.exists(O(seen.number)):
            values.insert(O(seen.number), to_pose3(starts[seen.drive] @ seen.drive_from_object))
        noise = gtsam.noiseModel.Gaussian.Covariance(to_gtsam_covariance(seen.covariance))
        robust = gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Cauchy.Create(_ROBUST), noise)
        place = to_pose3(seen.drive_from_object)
        graph.push_back(gtsam.BetweenFactorPose3(D(seen.drive), O(seen.number), place, robust))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setMaxIterations(_ITERATIONS)
    parameters.setOrderingType("COLAMD")
    solved = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    return _laid(graph, solved, ordered, sorted(starts))


def _prior(drive: int, start: Pose, prior: DrivePrior | None) -> gtsam.NonlinearFactor:
    """Of the drive whose world is the common one, its place is exactly known."""
    about = start if prior is None else prior.world_from_drive
    sigmas = np.full(6, _HELD) if prior is None else prior.sigmas()
    return gtsam.PriorFactorPose3(D(drive), to_pose3(about), gtsam.noiseModel.Diagonal.Sigmas(sigmas))


def _laid(
    graph: gtsam.NonlinearFactorGraph, solved: gtsam.Values, observations: Sequence[ObjectInDrive], drives: list[int]
) -> LaidDrives:
    marginals = gtsam.Marginals(graph, solved)
    placed = {drive: from_pose3(solved.atPose3(D(drive))) for drive in drives}
    numbers = sorted({seen.number for seen in observations})
    objects = {number: from_pose3(solved.atPose3(O(number))) for number in numbers}
    residuals = {
        (o.drive, o.number): objects[o.number].local(placed[o.drive] @ o.drive_from_object) for o in observations
    }
    errors = {
        (o.drive, o.number): float(r @ np.linalg.solve(o.covariance, r))
        for o, r in zip(observations, residuals.values(), strict=True)
    }
    own = {number: to_gtsam_covariance(marginals.marginalCovariance(O(number))) for number in numbers}
    return LaidDrives(placed, _joint(marginals, drives), objects, own, residuals, errors)


def _joint(marginals: gtsam.Marginals, drives: list[int]) -> Floats:
    """Joint covariance (6 d, 6 d) of the drives, in our order of tangents."""
    keys = gtsam.KeyVector([D(drive) for drive in drives])
    joint = marginals.jointMarginalCovariance(keys)
    rows = [[to_gtsam_covariance(joint.at(a, b)) for b in keys] for a in keys]
    found: Floats = np.block(rows)
    return found
