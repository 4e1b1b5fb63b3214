import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from meshslam.geometry import Pose
from meshslam.maps import Map, MapObject


@pytest.fixture
def make_object(rng):
    def make(number=1, **changes):
        ball = trimesh.creation.icosphere(subdivisions=2)
        vertices = np.array(ball.vertices) * rng.uniform(0.9, 1.1, (len(ball.vertices), 1)) * [2.1, 0.9, 0.7]
        factor = rng.normal(size=(6, 6))
        fields = {
            "id": number,
            "category": "car",
            "world_from_object": Pose(Rotation.random(rng=rng).as_matrix(), 10 * rng.normal(size=3)),
            "vertices": vertices,
            "faces": np.array(ball.faces),
            "views": 7,
            "first_frame": 2,
            "last_frame": 9,
            "mask_iou": 0.87,
            "keypoints": {"b": rng.normal(size=3), "a": rng.normal(size=3)},
            "pose_covariance": 1e-3 * factor @ factor.T,
            "vertex_sigma_m": rng.uniform(0.01, 0.2, len(vertices)),
            "vertex_observed": rng.random(len(vertices)) < 0.5,
        }
        return MapObject(**(fields | changes))

    return make


@pytest.fixture
def a_map(make_object):
    return Map(
        (make_object(12), make_object(3), make_object(7, pose_covariance=None, vertex_sigma_m=None, mask_iou=None))
    )
