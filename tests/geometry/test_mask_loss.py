"""The mask loss draws what the renderer draws, and names what is wrong with its input."""

import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.errors import GeometryError
from meshslam.geometry import Camera, MaskLoss, Pose, render

CAMERA = Camera(620, 188, 721.5, 721.5, 310.0, 90.0)
CAR = load_category("car")
AHEAD = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])  # camera from an object that faces away


def pose_at(distance_m, yaw_rad=0.7, aside_m=0.0):
    turned = AHEAD @ Pose.from_yaw(yaw_rad, np.zeros(3)).rotation
    return Pose(turned, np.array([aside_m, 0.9, distance_m]))


@pytest.mark.parametrize("pose", [pose_at(8.0), pose_at(30.0), pose_at(6.0, 2.0, 3.5), pose_at(1.0)])
def test_the_contour_draws_the_same_pixels_as_the_triangles(pose):
    loss = MaskLoss(CAMERA, len(CAR.vertices), CAR.faces, np.zeros((2, 2), np.uint8))
    triangles = render(CAMERA, [(pose, CAR.vertices, CAR.faces)]).mask
    np.testing.assert_array_equal(loss.draw(pose, CAR.vertices), triangles)


def test_bad_input_is_named():
    with pytest.raises(GeometryError, match="face 0 names vertex 9"):
        MaskLoss(CAMERA, 3, np.array([[0, 1, 9]]), np.zeros((4, 4), np.uint8))
    loss = MaskLoss(CAMERA, 3, np.array([[0, 1, 2]]), np.zeros((4, 4), np.uint8))
    with pytest.raises(GeometryError, match="finite"):
        loss.gradient(pose_at(8.0), np.full((3, 3), np.nan))
    with pytest.raises(GeometryError, match="vertices must have shape"):
        loss.gradient(pose_at(8.0), np.zeros((4, 3)))
