import itertools
from dataclasses import replace

import numpy as np
import pytest

from meshslam.localization.gradient_estimator import camera_value
from meshslam.localization.map_models import known_objects
from meshslam.object_slam.joint_gradient import joint_descent, joint_problem
from tests.fixtures.imu_street import errors_m


@pytest.fixture(scope="module")
def shaken(street):
    rng = np.random.default_rng(6)
    sigmas = np.array([0.08] * 3 + [0.006] * 3)
    first, *others = street.world_from_camera
    return (first, *(pose.retract(rng.normal(0, sigmas)) for pose in others))


@pytest.fixture(scope="module")
def few(drive, street):
    """The first frames are enough for laws."""
    count = 6
    return replace(
        drive, frame_ids=drive.frame_ids[:count], times_s=drive.times_s[:count], world_from_camera=None
    ), street.world_from_camera[:count]


def test_cameras_and_loss_come_down(few, shaken, seen, scene):
    sequence, truth = few
    start = shaken[: len(truth)]
    paths = joint_descent(sequence, seen, start, scene, 0.01, 8)
    assert len(paths) == 9
    before, after = (errors_m(path, truth)[1:] for path in (paths[0], paths[-1]))
    assert after.mean() < 0.6 * before.mean()
    assert np.allclose(paths[-1][0].matrix, truth[0].matrix)  # the first says where the world is


def test_no_iteration_raises_the_loss(few, shaken, seen, scene):
    sequence, truth = few
    objects = {o.id: o for o in known_objects(scene)}
    problem = joint_problem(sequence, seen, shaken[: len(truth)], objects, 0.01)
    losses = [problem.loss()]
    for _ in range(3):
        problem.iterate()
        losses.append(problem.loss())
    assert all(after <= before + 1e-9 for before, after in itertools.pairwise(losses))


def test_objects_move_too(few, seen, scene):
    sequence, truth = few
    objects = {o.id: o for o in known_objects(scene)}
    wrong = {
        k: replace(o, world_from_object=o.world_from_object.retract(np.array([0.3, 0.2, 0.0, 0, 0, 0.05])))
        for k, o in objects.items()
    }
    problem = joint_problem(sequence, seen, truth, wrong, 0.01)
    before = problem.loss()
    for _ in range(5):
        problem.iterate()
    moved = [
        np.linalg.norm(problem.objects[k].world_from_object.translation - o.world_from_object.translation)
        for k, o in wrong.items()
    ]
    assert problem.loss() < before
    assert max(moved) > 0.02


def test_the_cameras_slope_is_that_of_the_loss(few, seen, scene):
    sequence, truth = few
    problem = joint_problem(sequence, seen, truth, {o.id: o for o in known_objects(scene)}, 0.01)
    views = [replace(view, mask=None) for view in problem.losses[3]]  # masks have laws of their own
    pose = truth[3].retract(np.array([0.05, -0.03, 0.04, 0.002, -0.001, 0.003]))
    _, slope = camera_value(pose, views)
    for i in range(6):
        step = np.zeros(6)
        step[i] = 1e-6
        ahead, behind = (camera_value(pose.retract(sign * step), views)[0] for sign in (1, -1))
        assert slope[i] == pytest.approx((ahead - behind) / 2e-6, rel=1e-4, abs=1e-5)


def test_a_camera_that_sees_nothing_goes_with_the_one_before(few, shaken, seen, scene):
    sequence, truth = few
    kept = tuple(d for d in seen.detections if d.frame != 4)
    start = shaken[: len(truth)]
    paths = joint_descent(sequence, replace(seen, detections=kept), start, scene, 0.01, 2)
    step = paths[-1][3].inverse() @ paths[-1][4]
    assert np.allclose(step.matrix, (start[3].inverse() @ start[4]).matrix)
