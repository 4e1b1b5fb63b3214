"""Gradients of the mask loss against a supersampled area IoU, and against the published figures of Kato's renderer."""

import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.errors import GeometryError
from meshslam.geometry import Camera, MaskLoss, Pose, exp_so3, kato_pixel_gradient, mask_gradients, render

CAMERA = Camera(620, 188, 721.5, 721.5, 310.0, 90.0)
CAR = load_category("car")
AHEAD = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])  # camera from an object that faces away


def pose_at(distance_m, yaw_rad=0.7, aside_m=0.0):
    turned = AHEAD @ Pose.from_yaw(yaw_rad, np.zeros(3)).rotation
    return Pose(turned, np.array([aside_m, 0.9, distance_m]))


def observed_at(distance_m):
    return render(CAMERA, [(pose_at(distance_m, 0.75, 0.15), CAR.vertices * 1.03, CAR.faces)]).mask


def area_loss(pose, vertices, observed, times):
    """-IoU of areas: the mesh is drawn with `times` x `times` samples a pixel."""
    fine = Camera(
        CAMERA.width * times,
        CAMERA.height * times,
        CAMERA.fx * times,
        CAMERA.fy * times,
        (CAMERA.cx + 0.5) * times - 0.5,
        (CAMERA.cy + 0.5) * times - 0.5,
    )
    drawn = render(fine, [(pose, vertices, CAR.faces)]).mask.reshape(CAMERA.height, times, CAMERA.width, times)
    share = drawn.mean((1, 3))
    both = (share * observed).sum()
    return -both / (share.sum() + observed.sum() - both)


def cosine(a, b):
    return float((a * b).sum() / np.linalg.norm(a) / np.linalg.norm(b))


@pytest.mark.parametrize("distance_m", [8.0, 15.0, 30.0])
def test_exact_gradient_over_the_pose_is_that_of_the_area(distance_m):
    observed, pose, times = observed_at(distance_m), pose_at(distance_m), 6
    found = MaskLoss(CAMERA, len(CAR.vertices), CAR.faces, observed).gradient(pose, CAR.vertices)
    numeric = np.zeros(6)
    for k, step in enumerate([0.02] * 3 + [0.01] * 3):
        xi = np.eye(6)[k] * step
        ends = [
            Pose(pose.rotation @ exp_so3(s * xi[3:]), pose.translation + pose.rotation @ (s * xi[:3])) for s in (1, -1)
        ]
        numeric[k] = np.subtract(*(area_loss(end, CAR.vertices, observed, times) for end in ends)) / (2 * step)
    assert cosine(found.object, numeric) > 0.999
    assert np.linalg.norm(found.object) == pytest.approx(np.linalg.norm(numeric), rel=0.05)


@pytest.mark.parametrize("distance_m", [8.0, 15.0])
def test_exact_gradient_over_vertices_is_that_of_the_area(distance_m, rng):
    observed, pose, times = observed_at(distance_m), pose_at(distance_m), 12
    found = MaskLoss(CAMERA, len(CAR.vertices), CAR.faces, observed).gradient(pose, CAR.vertices)
    moving = np.flatnonzero(np.abs(found.vertices).sum(1) > 0)
    chosen = np.concatenate([rng.choice(moving, 6, replace=False), rng.choice(len(CAR.vertices), 2, replace=False)])
    step, numeric = 0.15 * distance_m / CAMERA.fx, np.zeros((len(chosen), 3))
    for row, vertex in enumerate(chosen):
        for axis in range(3):
            offset = np.zeros_like(CAR.vertices)
            offset[vertex, axis] = step
            ends = (area_loss(pose, CAR.vertices + s * offset, observed, times) for s in (1, -1))
            numeric[row, axis] = np.subtract(*ends) / (2 * step)
    assert cosine(found.vertices[chosen], numeric) > 0.99


def test_the_camera_moves_as_the_opposite_of_the_object_in_its_own_frame():
    observed, pose = observed_at(8.0), pose_at(8.0)
    found = MaskLoss(CAMERA, len(CAR.vertices), CAR.faces, observed).gradient(pose, CAR.vertices)
    np.testing.assert_allclose(found.camera[:3], -pose.rotation @ found.object[:3], atol=1e-12)


@pytest.mark.parametrize("pose", [pose_at(8.0), pose_at(30.0), pose_at(6.0, 2.0, 3.5), pose_at(1.0)])
def test_the_contour_draws_the_same_pixels_as_the_triangles(pose):
    loss = MaskLoss(CAMERA, len(CAR.vertices), CAR.faces, np.zeros((2, 2), np.uint8))
    triangles = render(CAMERA, [(pose, CAR.vertices, CAR.faces)]).mask
    np.testing.assert_array_equal(loss.draw(pose, CAR.vertices), triangles)


def test_both_gradients_lower_the_loss():
    observed, pose = observed_at(10.0), pose_at(10.0)
    loss = MaskLoss(CAMERA, len(CAR.vertices), CAR.faces, observed)
    for method in ("exact", "kato"):
        found = loss.gradient(pose, CAR.vertices, method)
        step = -0.05 * found.object[:3] / np.linalg.norm(found.object[:3])
        moved = Pose(pose.rotation, pose.translation + pose.rotation @ step)
        assert loss.gradient(moved, CAR.vertices).loss < found.loss


@pytest.mark.parametrize("order", [(0, 1, 2), (0, 2, 1)])
def test_kato_gives_the_published_figures(order):
    size = 64
    triangle = np.array([[0.8, 0.8], [0.0, -0.5], [0.2, -0.4]])
    pixels = 0.5 * (triangle * size + size - 1)
    pixels[:, 1] = size - 1 - pixels[:, 1]
    columns, rows = np.meshgrid(np.arange(size), np.arange(size))
    ends = np.roll(pixels, -1, axis=0)
    sides = [
        (b[0] - a[0]) * (rows - a[1]) - (b[1] - a[1]) * (columns - a[0]) for a, b in zip(pixels, ends, strict=True)
    ]
    inside = np.all([s >= 0 for s in sides], axis=0) | np.all([s <= 0 for s in sides], axis=0)
    slope = np.zeros((size, size))
    slope[25, 35] = -1.0  # of |1 - s| where nothing is drawn
    found = kato_pixel_gradient(pixels, np.array([order]), np.where(inside, 0, -1), slope)
    in_units = found * size / 2 * [1, -1]
    np.testing.assert_allclose(in_units, [[1.6726, -0.2602], [1.4199, -1.6428], [0, 0]], rtol=0.01, atol=1e-9)


def test_many_views_give_what_each_gives_alone():
    poses = [pose_at(d) for d in (8.0, 12.0, 20.0)]
    losses = [MaskLoss(CAMERA, len(CAR.vertices), CAR.faces, observed_at(d)) for d in (8.0, 12.0, 20.0)]
    for threads in (1, 2):
        together = mask_gradients(losses, poses, CAR.vertices, threads)
        for loss, pose, found in zip(losses, poses, together, strict=True):
            np.testing.assert_array_equal(found.vertices, loss.gradient(pose, CAR.vertices).vertices)


def test_bad_input_is_named():
    with pytest.raises(GeometryError, match="face 0 names vertex 9"):
        MaskLoss(CAMERA, 3, np.array([[0, 1, 9]]), np.zeros((4, 4), np.uint8))
    loss = MaskLoss(CAMERA, 3, np.array([[0, 1, 2]]), np.zeros((4, 4), np.uint8))
    with pytest.raises(GeometryError, match="finite"):
        loss.gradient(pose_at(8.0), np.full((3, 3), np.nan))
    with pytest.raises(GeometryError, match="vertices must have shape"):
        loss.gradient(pose_at(8.0), np.zeros((4, 3)))
    with pytest.raises(GeometryError, match="slope must have shape"):
        kato_pixel_gradient(np.zeros((3, 2)), np.array([[0, 1, 2]]), np.zeros((4, 4), int), np.zeros((5, 4)))
