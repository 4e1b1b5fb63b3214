"""The paper's equations against central differences, against their symbolic twin, and against their own laws."""

import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.errors import GeometryError
from meshslam.geometry import (
    Camera,
    Pose,
    camera_points,
    exp_so3,
    hat,
    keypoint_loss,
    keypoint_loss_gradient,
    keypoint_pixels,
    log_so3,
    mask_loss,
    mask_loss_gradient,
    mesh_masks,
    pixel_derivatives,
    projection_derivative,
    render,
    right_jacobian,
    selection,
)
from tests.reference import paper_equations

CAMERA = Camera(1242, 375, 721.5, 698.0, 609.6, 172.9, 3.7)
CAR = load_category("car")
ANGLES = [1e-12, 1e-8, 0.99e-4, 1.01e-4, 1e-2, 1.0, 2.5, np.pi - 1e-3, np.pi - 1e-7, np.pi]
STATES = ("theta_c", "p_c", "theta_o", "p_o")


def direction(rng):
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def random_states(rng, count, angle_c=None, angle_o=None, depth_m=None):
    """States whose object lies before the camera; `depth_m` is that of its origin."""
    theta_c = np.array(
        [direction(rng) * (angle_c if angle_c is not None else rng.uniform(0, np.pi)) for _ in range(count)]
    )
    theta_o = np.array(
        [direction(rng) * (angle_o if angle_o is not None else rng.uniform(0, np.pi)) for _ in range(count)]
    )
    p_c = rng.uniform(-5, 5, (count, 3))
    depth = rng.uniform(4, 30, count) if depth_m is None else np.full(count, depth_m)
    in_camera = np.stack([rng.uniform(-1, 1, count), rng.uniform(-1, 1, count), np.ones(count)], -1) * depth[:, None]
    p_o = p_c + np.einsum("bij,bj->bi", exp_so3(theta_c), in_camera)
    return theta_c, p_c, theta_o, p_o


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("which", [0, 2])
def test_derivatives_are_those_of_the_symbols(rng, angle, which):
    states = random_states(rng, 3, **{"angle_c" if which == 0 else "angle_o": angle})
    points = rng.uniform(-1.5, 1.5, (3, 2, 3))
    pixels, found = keypoint_pixels(CAMERA, *states, points), pixel_derivatives(CAMERA, *states, points)
    for b in range(3):
        for k in range(2):
            args = [state[b] for state in states]
            gamma, pixel, expected = paper_equations.pixel_and_derivatives(CAMERA, *args, points[b, k])
            np.testing.assert_allclose(camera_points(*args, points[b])[k], gamma, rtol=1e-12, atol=1e-12)
            np.testing.assert_allclose(pixels[b, k], pixel, rtol=1e-11)
            for name in (*STATES, "vertices"):
                derivative = expected["v" if name == "vertices" else name]
                scale = np.abs(derivative).max()
                np.testing.assert_allclose(getattr(found, name)[b, k], derivative, rtol=1e-9, atol=1e-11 * scale)


@pytest.mark.parametrize("angle", [0.0, *ANGLES])
def test_derivatives_are_those_of_central_differences(rng, angle):
    states = random_states(rng, 20, angle_c=angle, angle_o=angle)
    points = rng.uniform(-1.5, 1.5, (20, 4, 3))
    found = pixel_derivatives(CAMERA, *states, points)
    for number, name in enumerate((*STATES, "vertices")):
        for axis in range(3):
            step = np.eye(3)[axis] * 1e-5

            def pixels(sign, number=number, step=step):
                moved = list((*states, points))
                moved[number] = moved[number] + sign * step
                return keypoint_pixels(CAMERA, *moved)

            numeric = (pixels(1) - pixels(-1)) / 2e-5
            exact = getattr(found, name)[..., axis]
            np.testing.assert_allclose(exact, numeric, rtol=1e-6, atol=1e-7 * np.abs(exact).max())


@pytest.mark.parametrize("depth_m", [1e-2, 1e-4, 1e-6])
def test_points_near_the_image_plane_keep_their_digits(rng, depth_m):
    states = random_states(rng, 3, depth_m=1.0)
    rotation = exp_so3(states[0])
    in_camera = np.concatenate([rng.uniform(-0.5, 0.5, (3, 2)), np.full((3, 1), depth_m)], 1)
    in_world = np.einsum("bij,bj->bi", rotation, in_camera) + states[1]
    point = np.einsum("bji,bj->bi", exp_so3(states[2]), in_world - states[3])[:, None]
    found = pixel_derivatives(CAMERA, *states, point)
    for b in range(3):
        _, _, expected = paper_equations.pixel_and_derivatives(CAMERA, *(s[b] for s in states), point[b, 0])
        for name in (*STATES, "vertices"):
            derivative = expected["v" if name == "vertices" else name]
            # the depth itself is known to a few 1e-16 m only, and enters squared
            np.testing.assert_allclose(
                getattr(found, name)[b, 0],
                derivative,
                rtol=1e-14 / depth_m,
                atol=1e-13 / depth_m * np.abs(derivative).max(),
            )


def test_points_on_and_behind_the_image_plane_have_no_pixel():
    zero = np.zeros(3)
    points = np.array([[0.1, 0.2, 0.0], [0.1, 0.2, -3.0], [0.1, 0.2, 3.0]])
    pixels = keypoint_pixels(CAMERA, zero, zero, zero, zero, points)
    assert np.isnan(pixels[:2]).all()
    assert np.isfinite(pixels[2]).all()
    assert np.isnan(projection_derivative(CAMERA, points)[:2]).all()
    assert np.isfinite(projection_derivative(CAMERA, points)[2]).all()


@pytest.mark.parametrize("angle", ANGLES)
def test_the_right_jacobian_is_that_of_the_symbols(rng, angle):
    theta = direction(rng) * angle
    np.testing.assert_allclose(right_jacobian(theta), paper_equations.right_jacobian(theta), atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, *ANGLES[:-1]])
def test_exponential_logarithm_and_right_jacobian_agree(rng, angle):
    theta = np.array([direction(rng) * angle for _ in range(20)])
    rotation = exp_so3(theta)
    np.testing.assert_allclose(
        rotation @ np.swapaxes(rotation, -1, -2), np.broadcast_to(np.eye(3), (20, 3, 3)), atol=1e-14
    )
    np.testing.assert_allclose(log_so3(rotation), theta, atol=1e-9)
    delta = rng.normal(size=(20, 3)) * 1e-7
    moved = exp_so3(theta) @ exp_so3(np.einsum("bij,bj->bi", right_jacobian(theta), delta))
    np.testing.assert_allclose(exp_so3(theta + delta), moved, atol=1e-13)
    np.testing.assert_array_equal(right_jacobian(np.zeros(3)), np.eye(3))


def test_hat_is_the_cross_product(rng):
    a, b = rng.normal(size=(2, 7, 3))
    np.testing.assert_allclose(np.einsum("bij,bj->bi", hat(a), b), np.cross(a, b), atol=1e-15)


def test_batches_broadcast_and_give_what_each_view_gives_alone(rng):
    theta_c, p_c, theta_o, p_o = random_states(rng, 6)
    vertices, association = rng.uniform(-1, 1, (9, 3)), rng.uniform(0, 1, (9, 4))
    one_object = (theta_c, p_c, theta_o[0], p_c + np.einsum("bij,j->bi", exp_so3(theta_c), [0.3, 0.2, 9.0]))
    together = keypoint_pixels(CAMERA, *one_object, vertices, association)
    assert together.shape == (6, 4, 2)
    derivatives = pixel_derivatives(CAMERA, *one_object, vertices)
    assert derivatives.theta_o.shape == (6, 9, 2, 3)
    stacked = (a.reshape(2, 3, 3) for a in (theta_c, p_c, np.broadcast_to(theta_o[0], (6, 3)), one_object[3]))
    np.testing.assert_array_equal(keypoint_pixels(CAMERA, *stacked, vertices, association).reshape(6, 4, 2), together)
    for b in range(6):
        alone = (theta_c[b], p_c[b], theta_o[0], one_object[3][b])
        np.testing.assert_allclose(keypoint_pixels(CAMERA, *alone, vertices, association), together[b], rtol=1e-13)
        for name in (*STATES, "vertices"):
            one = getattr(pixel_derivatives(CAMERA, *alone, vertices), name)
            np.testing.assert_allclose(one, getattr(derivatives, name)[b], rtol=1e-12, atol=1e-12)


def test_skew_moves_pixels_along_x_by_the_height_over_the_axis():
    plain, skewed = Camera(100, 80, 90.0, 95.0, 50.0, 40.0), Camera(100, 80, 90.0, 95.0, 50.0, 40.0, 6.0)
    point, zero = np.array([[0.3, -0.4, 2.0]]), np.zeros(3)
    shift = keypoint_pixels(skewed, zero, zero, zero, zero, point) - keypoint_pixels(
        plain, zero, zero, zero, zero, point
    )
    np.testing.assert_allclose(shift, [[6.0 * -0.4 / 2.0, 0.0]], atol=1e-12)


def test_masks_are_those_of_the_renderer(rng):
    theta_c = np.array([[0.0, 0.0, 0.0], [0.02, -0.05, 0.01]])
    theta_o = log_so3(np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]))
    p_c, p_o = np.zeros((2, 3)), np.array([0.5, 0.9, 9.0])
    masks = mesh_masks(CAMERA, theta_c, p_c, theta_o, p_o, CAR.vertices, CAR.faces)
    assert masks.shape == (2, 375, 1242)
    for k in range(2):
        camera_from_object = Pose(exp_so3(theta_c[k]), p_c[k]).inverse() @ Pose(exp_so3(theta_o), p_o)
        np.testing.assert_array_equal(masks[k], render(CAMERA, [(camera_from_object, CAR.vertices, CAR.faces)]).mask)
    assert masks[0].sum() > 5000


def test_vis_selects_what_was_detected(rng):
    vis = selection(np.array([4, 1]), 6)
    predicted = rng.normal(size=(6, 2))
    np.testing.assert_array_equal(vis.T @ predicted, predicted[[4, 1]])
    assert vis.shape == (6, 2)
    assert selection(np.zeros((5, 0), int), 3).shape == (5, 3, 0)
    for bad in (-1, 6):
        with pytest.raises(GeometryError, match=f"key point {bad} is out of range: there are 6"):
            selection(np.array([0, bad]), 6)
    with pytest.raises(GeometryError, match="indices"):
        selection(np.array([0.5]), 6)


def test_the_keypoint_loss_is_that_of_the_symbols(rng):
    predicted, observed = rng.normal(size=(5, 2)) * 100, rng.normal(size=(3, 2)) * 100
    vis = selection(np.array([3, 0, 3]), 5)  # a point may be detected twice
    loss, gradient = paper_equations.keypoint_loss_and_gradient(observed, predicted, vis)
    assert keypoint_loss(observed, predicted, vis) == pytest.approx(loss, rel=1e-12)
    np.testing.assert_allclose(keypoint_loss_gradient(observed, predicted, vis), gradient, rtol=1e-12, atol=1e-10)
    many = keypoint_loss_gradient(np.stack([observed] * 4), np.stack([predicted] * 4), vis)
    np.testing.assert_allclose(many, np.stack([gradient] * 4), rtol=1e-12, atol=1e-10)


def test_a_keypoint_without_a_pixel_counts_only_where_it_was_detected():
    predicted = np.array([[1.0, 2.0], [np.nan, np.nan]])
    assert keypoint_loss(np.array([[1.0, 4.0]]), predicted, selection(np.array([0]), 2)) == 4.0
    with pytest.raises(GeometryError, match="was detected"):
        keypoint_loss(np.array([[1.0, 4.0]]), predicted, selection(np.array([1]), 2))


@pytest.mark.parametrize("hard", [True, False])
def test_the_mask_loss_is_that_of_the_symbols(rng, hard):
    observed = (rng.random((3, 4)) > 0.5).astype(float)
    predicted = (rng.random((3, 4)) > 0.4).astype(float) if hard else rng.random((3, 4)).round(3)
    loss, gradient = paper_equations.mask_loss_and_gradient(observed, predicted)
    assert mask_loss(observed, predicted) == pytest.approx(loss, rel=1e-13)
    np.testing.assert_allclose(mask_loss_gradient(observed, predicted), gradient, rtol=1e-12)
    np.testing.assert_allclose(mask_loss_gradient(observed, np.stack([predicted] * 2))[1], gradient, rtol=1e-12)


def test_masks_that_agree_cost_minus_one_and_empty_ones_pull_nothing():
    full, empty = np.ones((4, 5), np.uint8), np.zeros((4, 5), np.uint8)
    assert mask_loss(full, full) == -1.0
    assert mask_loss(full, empty) == 0.0
    assert mask_loss(empty, empty) == -1.0
    assert not mask_loss_gradient(empty, empty).any()


BAD = [
    ({"theta_c": np.array([0, np.nan, 0])}, r"theta_c must be finite, but entry \(1,\) is nan"),
    ({"p_o": np.array([0, 0, np.inf])}, r"p_o must be finite, but entry \(2,\) is inf"),
    ({"vertices": np.full((4, 3), np.nan)}, r"vertices must be finite, but entry \(0, 0\)"),
    ({"vertices": np.zeros((4, 2))}, r"vertices has shape \(4, 2\)"),
    ({"p_c": np.zeros(2)}, r"p_c has shape \(2,\)"),
    ({"association": np.zeros((3, 2))}, "association has shape"),
]


@pytest.mark.parametrize(("change", "words"), BAD)
def test_bad_input_is_named(change, words):
    good = {name: np.zeros(3) for name in STATES} | {"vertices": np.ones((4, 3)), "association": None}
    with pytest.raises(GeometryError, match=words):
        keypoint_pixels(CAMERA, **(good | change))


def test_bad_masks_are_named():
    with pytest.raises(GeometryError, match="masks must have one size"):
        mask_loss(np.zeros((3, 4)), np.zeros((4, 3)))
    with pytest.raises(GeometryError, match="predicted must be finite"):
        mask_loss_gradient(np.zeros((3, 4)), np.full((3, 4), np.nan))
    with pytest.raises(GeometryError, match="vis has shape"):
        keypoint_loss(np.zeros((3, 2)), np.zeros((4, 2)), np.zeros((4, 2)))
    with pytest.raises(GeometryError, match="face 0 names vertex 7"):
        mesh_masks(CAMERA, *np.zeros((4, 3)), np.ones((4, 3)), np.array([[0, 1, 7]]))
    assert not mesh_masks(CAMERA, *np.zeros((4, 3)), np.zeros((0, 3)), np.zeros((0, 3), int)).any()
