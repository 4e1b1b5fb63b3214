"""The object model's binding; its mathematics are the core's laws."""

import cv2
import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.errors import GeometryError
from meshslam.geometry import Camera, NoiseModel, ObjectModel, Pose, hat, render

CAMERA = Camera(400, 200, 250.0, 250.0, 200.0, 100.0)
AHEAD = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])  # camera from an object that faces away


@pytest.fixture(scope="module")
def model():
    car = load_category("car")
    return ObjectModel(car.vertices, car.faces, car.modes[:4], car.mirror, car.keypoint_weights, car.wheel_vertices)


@pytest.fixture(scope="module")
def state(model):
    return model.state_at(Pose(AHEAD @ Pose.from_yaw(0.6, np.zeros(3)).rotation, np.array([0.2, 0.8, 7.0])))


@pytest.fixture(scope="module")
def view(model, state):
    """The mask that the state itself draws."""
    mask = render(CAMERA, [(state.world_from_object, model.vertices(state), model.faces)]).mask.astype(np.uint8)
    inside, outside = (cv2.distanceTransform(m, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) for m in (mask, 1 - mask))
    contour = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0][0][::3, 0]
    nowhere, none = np.zeros(mask.shape, bool), np.zeros(0)
    return model.view(
        CAMERA,
        Pose.identity(),
        origin=(0, 0),
        distance_px=np.where(mask > 0, 0.5 - inside, outside - 0.5),
        cut=nowhere,
        hidden=nowhere,
        border=contour.astype(float),
        border_length_px=np.full(len(contour), 3.0),
        border_own=np.ones(len(contour), bool),
        keypoint_index=none,
        keypoint_pixels=none,
        keypoint_sigma_px=none,
    )


def test_the_covariance_of_the_pose_moved_to_the_centre_is_that_of_uncertainty(model, state, view):
    scope = {"modes": False, "free_form": False}
    at_centre, _, _ = model.uncertainty([view], None, NoiseModel(), state, **scope, per_vertex=False)
    at_origin = model.covariance([view], None, NoiseModel(), state, ["pose"], **scope)
    vertices = model.vertices(state)
    moved = np.eye(6)
    moved[:3, 3:] = -hat((vertices.min(axis=0) + vertices.max(axis=0)) / 2)
    np.testing.assert_allclose(moved @ at_origin @ moved.T, at_centre, rtol=1e-6, atol=1e-12)


def test_blocks_of_a_covariance_stand_in_the_order_named(model, state, view):
    scope = {"modes": True, "free_form": False}
    both = model.covariance([view], None, NoiseModel(), state, ["pose", "modes"], **scope)
    turned = model.covariance([view], None, NoiseModel(), state, ["modes", "pose"], **scope)
    order = [*range(6, 10), *range(6)]
    np.testing.assert_allclose(turned, both[np.ix_(order, order)], rtol=1e-9)
    assert np.linalg.eigvalsh(both).min() > 0


@pytest.mark.parametrize(
    ("block", "message"),
    [("velocity", "velocity is not estimated"), ("shape", 'no block of parameters is called "shape"')],
)
def test_a_block_that_is_not_there_has_no_covariance(model, state, view, block, message):
    with pytest.raises(GeometryError, match=message):
        model.covariance([view], None, NoiseModel(), state, [block], modes=True, free_form=False)


def test_what_nothing_holds_has_no_covariance(model, state):
    with pytest.raises(GeometryError, match="positive definite"):
        model.covariance([], None, NoiseModel(), state, ["pose"], modes=False, free_form=False)
