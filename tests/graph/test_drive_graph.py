"""A pose graph over drives: worlds follow from the objects that several drives saw."""

import numpy as np

from meshslam.geometry import Pose
from meshslam.graph import DrivePrior, ObjectInDrive, lay_drives

SIGMAS = np.array([0.05, 0.05, 0.05, 0.01, 0.01, 0.01])


def observed(rng, world_from_drive, objects, noise=1.0):
    """Objects as each drive saw them."""
    return [
        ObjectInDrive(
            drive, number, (pose.inverse() @ place).retract(noise * rng.normal(0, SIGMAS)), np.diag(SIGMAS**2)
        )
        for drive, pose in world_from_drive.items()
        for number, place in objects.items()
    ]


def scene(rng, count=8):
    drives = {
        0: Pose.identity(),
        1: Pose.from_yaw(1.0, np.array([20.0, -5.0, 1.0])),
        2: Pose.from_yaw(-2.0, np.ones(3)),
    }
    places = {n: Pose.from_yaw(float(rng.uniform(-3, 3)), rng.uniform(-20, 20, 3)) for n in range(count)}
    starts = {n: pose.retract(rng.normal(0, [0.3] * 3 + [0.02] * 3)) if n else pose for n, pose in drives.items()}
    return drives, places, starts


def test_exact_observations_give_exact_worlds(rng):
    drives, places, starts = scene(rng)
    laid = lay_drives(observed(rng, drives, places, noise=0.0), {}, 0, starts)
    for n, pose in drives.items():
        assert np.abs(laid.world_from_drive[n].matrix - pose.matrix).max() < 1e-5
    assert max(laid.errors.values()) < 1e-4


def test_covariances_agree_with_errors_over_many_noises():
    errors = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        drives, places, starts = scene(rng)
        laid = lay_drives(observed(rng, drives, places), {}, 0, starts)
        gap = laid.world_from_drive[1].local(drives[1])
        errors.append(gap @ np.linalg.solve(laid.covariance(1, 1), gap))
    assert 4.0 < np.mean(errors) < 8.5  # 6 are expected


def test_an_object_that_was_moved_bends_nothing(rng):
    drives, places, starts = scene(rng)
    seen = observed(rng, drives, places, noise=0.3)
    far = seen[8 + 3]
    shifted = ObjectInDrive(
        far.drive, far.number, far.drive_from_object @ Pose(np.eye(3), np.array([2.0, 0, 0])), far.covariance
    )
    laid = lay_drives([shifted if s is far else s for s in seen], {}, 0, starts)
    assert np.linalg.norm(laid.world_from_drive[1].translation - drives[1].translation) < 0.08
    assert max(laid.errors, key=laid.errors.get) == (far.drive, far.number)


def test_a_prior_holds_what_it_says_and_no_more(rng):
    drives, places, _ = scene(rng)
    tilted = {1: Pose.from_yaw(1.0, drives[1].translation + [3.0, 2.0, 0.0])}
    free = lay_drives(observed(rng, drives, places), {1: DrivePrior(tilted[1], tilt_rad=0.01)}, 0, drives | tilted)
    held = lay_drives(
        observed(rng, drives, places), {1: DrivePrior(tilted[1], 1e-4, 1e-4, 1e-4, 1e-4)}, 0, drives | tilted
    )
    assert np.linalg.norm(free.world_from_drive[1].translation - drives[1].translation) < 0.15
    assert np.linalg.norm(held.world_from_drive[1].translation - tilted[1].translation) < 0.05
