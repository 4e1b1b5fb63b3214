"""Kato's gradient against its literal twin and against the published figures of his renderer."""

import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.errors import GeometryError
from meshslam.geometry import Camera, MaskLoss, Pose, kato_pixel_gradient, mask_loss_gradient, render
from tests.reference import kato

SIZE = 64
# a camera whose pixels are those of a picture over [-1, 1]^2 of the points at depth 1: no perspective is left
FLAT = Camera(SIZE, SIZE, SIZE / 2, SIZE / 2, (SIZE - 1) / 2, (SIZE - 1) / 2)


def flat(points):
    """Points (n, 2) of a picture with y up, in the camera's frame."""
    return np.column_stack([points[:, 0], -points[:, 1], np.ones(len(points))])


@pytest.mark.parametrize("order", [(0, 1, 2), (0, 2, 1), (1, 2, 0), (2, 1, 0)])
def test_the_published_triangle(order):
    triangle = flat(np.array([[0.8, 0.8], [0.0, -0.5], [0.2, -0.4]]))
    faces = np.array([order])
    drawn = render(FLAT, [(Pose.identity(), triangle, faces)])
    assert drawn.mask[25, 35] == 0
    slope = np.zeros((SIZE, SIZE))
    slope[25, 35] = -1.0  # of |1 - s| where nothing is drawn
    found = kato_pixel_gradient(FLAT.project(triangle), faces, drawn.face_index, slope)
    in_units = found * SIZE / 2 * [1, -1]
    np.testing.assert_allclose(in_units, [[1.6726, -0.2602], [1.4199, -1.6428], [0, 0]], rtol=0.01, atol=1e-9)


@pytest.mark.parametrize("seed", range(12))
def test_the_literal_twin(seed):
    rng = np.random.default_rng(seed)
    camera = Camera(37, 29, 30.0, 33.0, 18.2, 14.1, 0.8)
    points = rng.uniform(-0.7, 0.7, (7, 3)) + [0, 0, 1.4]
    if seed % 3 == 0:  # vertices on pixel centres: edges along rows and columns, crossings on pixels
        points = np.column_stack([camera.rays(rng.integers(-3, 40, (7, 2)).astype(float))[:, :2], np.ones(7)])
        points *= rng.uniform(1, 2, (7, 1))
    faces = np.array([rng.permutation(7)[:3] for _ in range(6)] + [[0, 0, 1]])
    face_index = render(camera, [(Pose.identity(), points, faces)]).face_index
    slope = rng.normal(size=face_index.shape)
    pixels = camera.project(points)
    found = kato_pixel_gradient(pixels, faces, face_index, slope)
    expected = kato.pixel_gradient(pixels, faces, face_index, slope)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    assert np.abs(expected).max() > 0


def twin_of_the_loss(camera, pose, vertices, faces, observed):
    """Gradient over the vertices, in the object's frame, from the literal twin on the whole image."""
    drawn = render(camera, [(pose, vertices, faces)])
    in_camera = pose.transform(vertices)
    slope = mask_loss_gradient(observed, drawn.mask)
    on_image = kato.pixel_gradient(camera.project(in_camera), faces, drawn.face_index, slope)
    depth = in_camera[:, 2]
    by_x, by_y = on_image[:, 0] * camera.fx / depth, on_image[:, 1] * camera.fy / depth
    lifted = np.column_stack([by_x, by_y, -(by_x * in_camera[:, 0] + by_y * in_camera[:, 1]) / depth])
    return lifted @ pose.rotation


def test_the_loss_of_a_car_goes_back_as_the_twin_says():
    camera = Camera(110, 70, 160.0, 160.0, 55.0, 30.0)
    car = load_category("car")
    ahead = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]) @ Pose.from_yaw(0.6, np.zeros(3)).rotation
    pose = Pose(ahead, np.array([0.1, 0.6, 9.0]))
    observed = render(camera, [(Pose(ahead, np.array([0.3, 0.5, 9.0])), car.vertices, car.faces)]).mask
    found = MaskLoss(camera, len(car.vertices), car.faces, observed).gradient(pose, car.vertices, "kato")
    expected = twin_of_the_loss(camera, pose, car.vertices, car.faces, observed)
    np.testing.assert_allclose(found.vertices, expected, rtol=1e-7, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(found.object[:3], expected.sum(0), atol=1e-9 * np.abs(expected).sum())


@pytest.mark.parametrize("margin", [-3, 0, 4])
def test_edges_along_pixel_centres_are_pulled_in_and_out(margin):
    corners = np.array([[20.0, 18], [44, 18], [44, 40], [20, 40]])
    square = FLAT.rays(corners)
    square /= square[:, 2:]
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    observed = np.zeros((SIZE, SIZE), np.uint8)
    observed[18 - margin : 41 + margin, 20 - margin : 45 + margin] = 1
    found = MaskLoss(FLAT, 4, faces, observed).gradient(Pose.identity(), square, "kato").vertices
    expected = twin_of_the_loss(FLAT, Pose.identity(), square, faces, observed)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
    assert np.abs(expected).max() > 1e-6


def test_it_lowers_the_loss():
    car = load_category("car")
    camera = Camera(620, 188, 721.5, 721.5, 310.0, 90.0)
    ahead = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]) @ Pose.from_yaw(0.7, np.zeros(3)).rotation
    pose = Pose(ahead, np.array([0.0, 0.9, 10.0]))
    observed = render(camera, [(Pose(ahead, np.array([0.15, 0.9, 10.0])), car.vertices * 1.03, car.faces)]).mask
    loss = MaskLoss(camera, len(car.vertices), car.faces, observed)
    for method in ("exact", "kato"):
        found = loss.gradient(pose, car.vertices, method)
        step = -0.05 * found.object[:3] / np.linalg.norm(found.object[:3])
        assert (
            loss.gradient(Pose(pose.rotation, pose.translation + pose.rotation @ step), car.vertices).loss < found.loss
        )


def test_a_mesh_beyond_what_numbers_tell_apart_pulls_nothing():
    camera = Camera(57, 49, 1e9, 14.25, 32.8, -5.1)
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    loss = MaskLoss(camera, 4, faces, np.ones((20, 30), np.uint8), (5, 7))
    found = loss.gradient(Pose(np.eye(3), np.array([-1e300, 0.0, 3.0])), vertices, method="kato")
    assert found.loss == 0
    for gradient in (found.vertices, found.object, found.camera):
        assert not gradient.any()


def test_bad_pictures_are_named():
    pixels, faces = np.zeros((3, 2)), np.array([[0, 1, 2]])
    with pytest.raises(GeometryError, match="slope must have shape"):
        kato_pixel_gradient(pixels, faces, np.zeros((4, 4), int), np.zeros((5, 4)))
    with pytest.raises(GeometryError, match="face_index holds 1, there are 1 faces"):
        kato_pixel_gradient(pixels, faces, np.ones((4, 4), int), np.zeros((4, 4)))
    with pytest.raises(GeometryError, match="slope must be finite"):
        kato_pixel_gradient(pixels, faces, np.zeros((4, 4), int), np.full((4, 4), np.nan))
