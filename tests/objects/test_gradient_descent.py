"""The paper's solver on a simulated street."""

from dataclasses import replace

import numpy as np
import pytest

from meshslam.geometry import MaskLoss, Pose, log_so3
from meshslam.objects import category_model
from meshslam.objects.config import GradientConfig, ObjectConfig
from meshslam.objects.gradient_descent import _GradientObservation, descend_pose, descend_shape, mean_curvature

WORLD_FROM_FORWARD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
QUICK = GradientConfig(pose_iterations=40, shape_iterations=40)


@pytest.fixture(scope="module")
def at():
    return Pose.from_yaw(0.4, np.array([9.0, 0.5, 0.7]))


def sight_of(camera, car, eye, true_pose, vertices, pixels=None, vis=None):
    """A view along x from `eye` of a car with these vertices."""
    world_from_camera = Pose(WORLD_FROM_FORWARD, np.asarray(eye, float))
    blank = MaskLoss(camera, len(vertices), car.faces, np.zeros((1, 1), np.uint8))
    seen = blank.draw(world_from_camera.inverse() @ true_pose, vertices)
    loss = MaskLoss(camera, len(vertices), car.faces, seen)
    pixels = np.zeros((0, 2)) if pixels is None else pixels
    vis = np.zeros((len(car.keypoint_names), 0)) if vis is None else vis
    return _GradientObservation(world_from_camera, log_so3(WORLD_FROM_FORWARD), loss, pixels, vis)


@pytest.fixture(scope="module")
def sights(camera, car, at):
    return [sight_of(camera, car, eye, at, car.vertices) for eye in ([0, -1.5, 1.2], [0, 1.5, 1.2])]


def mean_loss(sights, pose, vertices):
    return np.mean([s.mask.gradient(s.world_from_camera.inverse() @ pose, vertices).loss for s in sights])


def test_the_pose_descends_to_where_the_masks_agree(sights, camera, car, at):
    start = Pose.from_yaw(0.45, at.translation + [0.3, 0.2, 0.05])
    found = descend_pose(sights, camera, car, start, QUICK)
    before, after = mean_loss(sights, start, car.vertices), mean_loss(sights, found, car.vertices)
    assert after < before - 0.08
    assert after < -0.93


def test_key_points_alone_bring_the_pose_back(sights, camera, car, at):
    from meshslam.geometry import keypoint_pixels

    config = replace(QUICK, mask_weight=0.0, pose_iterations=300, keypoint_weight=1e-2)
    pixels = [
        keypoint_pixels(
            camera,
            s.theta_c,
            s.world_from_camera.translation,
            log_so3(at.rotation),
            at.translation,
            car.keypoints(car.vertices),
        )
        for s in sights
    ]
    everything = np.eye(len(car.keypoint_names))
    shown = [replace(s, pixels=p, vis=everything) for s, p in zip(sights, pixels, strict=True)]
    start = Pose.from_yaw(0.45, at.translation + [0.3, 0.2, 0.05])
    found = descend_pose(shown, camera, car, start, config)
    assert np.linalg.norm(found.translation - at.translation) < 0.05
    assert abs(found.yaw_rad - at.yaw_rad) < 0.01


def test_vertices_descend_to_another_cars_masks_and_stay_symmetric(camera, car, at):
    model = category_model(car)
    other = car.vertices * [1.05, 1.0, 1.1]
    seen = [sight_of(camera, car, eye, at, other) for eye in ([0, -1.5, 1.2], [0, 1.5, 1.2])]
    posed = model.state_at(at)
    found = model.vertices(descend_shape(seen, model, car, posed, QUICK))
    assert mean_loss(seen, at, found) < mean_loss(seen, at, car.vertices) - 0.03
    assert np.allclose(found[car.mirror], found * [1, -1, 1], atol=1e-12)


def test_curvature_of_a_flat_grid_is_none_and_of_a_spike_points_back():
    x, y = np.meshgrid(np.arange(5.0), np.arange(5.0))
    flat = np.stack([x.ravel(), y.ravel(), np.zeros(25)], 1)
    quads = [(i, i + 1, i + 5, i + 6) for r in range(4) for i in range(5 * r, 5 * r + 4)]
    faces = np.array([f for a, b, c, d in quads for f in ((a, b, d), (a, d, c))])
    laplacian = mean_curvature(flat, faces)
    inner = [6, 7, 8, 11, 12, 13, 16, 17, 18]
    assert np.abs((laplacian @ flat)[inner]).max() < 0.01  # the least weight of flat corners
    spike = flat.copy()
    spike[12, 2] = 1.0
    assert (laplacian @ spike)[12, 2] == pytest.approx(1.0)


def test_a_solver_of_no_such_name_is_refused():
    from meshslam.errors import ConfigError
    from meshslam.runs import overlaid

    with pytest.raises(ConfigError, match="expected residuals or gradient, found 'newton'"):
        overlaid(ObjectConfig(), {"solver": "newton"}, "here")
