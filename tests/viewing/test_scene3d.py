import base64

import numpy as np
import pytest

from meshslam.geometry import Pose
from meshslam.maps import Map
from meshslam.viewing.scene3d import FRUSTA, FRUSTUM_DEPTH_M, PATH_POINTS, UNIT_M, scene_data


def unpack(text, kind, columns=1):
    return np.frombuffer(base64.b64decode(text), np.dtype(kind).newbyteorder("<")).reshape(-1, columns)


def test_meshes_come_back_within_half_a_millimetre(cars, camera, path):
    data = scene_data(cars, camera, path)
    assert len(data["objects"]) == len(cars)
    for packed, thing in zip(data["objects"], cars.objects, strict=True):
        place = np.array(packed["matrix"]).reshape(3, 4)
        vertices = UNIT_M * unpack(packed["vertices"], "i2", 3)
        world = vertices @ place[:, :3].T + place[:, 3] + data["origin"]
        assert np.abs(world - thing.vertices_in_world).max() < 1e-3
        np.testing.assert_array_equal(unpack(data["faces"][packed["faces"]], "u4", 3), thing.faces)
        sigma = unpack(packed["sigma"], "u1")[:, 0] / 1000
        np.testing.assert_allclose(sigma, np.minimum(thing.vertex_sigma_m, 0.255), atol=6e-4)
        np.testing.assert_array_equal(unpack(packed["seen"], "u1")[:, 0] > 0, thing.vertex_observed)


def test_equal_topologies_are_kept_once(cars, make_car, camera, path):
    assert len(scene_data(cars, camera, path)["faces"]) == 1
    other = make_car(99, 5.0, 5.0, faces=cars.objects[0].faces[::-1])
    assert len(scene_data(Map((*cars.objects, other)), camera, path)["faces"]) == 2


def test_frusta_look_where_the_camera_does(cars, camera, path):
    data = scene_data(cars, camera, path)
    frusta = unpack(data["frusta"], "f4", 15).reshape(-1, 5, 3) + data["origin"]
    assert 2 <= len(frusta) <= len(path)
    in_camera = path[0].inverse().transform(frusta[0].astype(float))
    np.testing.assert_allclose(in_camera[0], 0, atol=1e-4)
    np.testing.assert_allclose(in_camera[1:, 2], FRUSTUM_DEPTH_M, atol=1e-4)
    corners = camera.project(in_camera[1:])
    ends = [[-0.5, -0.5], [camera.width - 0.5, -0.5], [camera.width - 0.5, camera.height - 0.5]]
    np.testing.assert_allclose(corners[:3], ends, atol=0.1)


def test_the_path_is_whole_or_thinned(cars, camera, path):
    data = scene_data(cars, camera, path)
    expected = np.array([pose.translation for pose in path])
    np.testing.assert_allclose(unpack(data["path"], "f4", 3) + data["origin"], expected, atol=1e-5)
    long = [Pose(np.eye(3), np.array([0.5 * i, 0.0, 1.0])) for i in range(2 * PATH_POINTS + 5)]
    data = scene_data(cars, camera, long)
    assert PATH_POINTS / 2 < len(unpack(data["path"], "f4", 3)) <= PATH_POINTS
    assert len(unpack(data["frusta"], "f4", 15)) <= FRUSTA


def test_far_from_the_origin_nothing_is_lost(make_car, camera):
    far = np.array([4.5e6, 5e5, 100.0])
    poses = [Pose(np.eye(3), far + [i, 0.0, 1.6]) for i in range(5)]
    data = scene_data(Map((make_car(1, far[0], far[1]),)), camera, poses)
    steps = np.diff(unpack(data["path"], "f4", 3), axis=0)
    np.testing.assert_allclose(steps, np.tile([1.0, 0.0, 0.0], (4, 1)), atol=1e-4)


@pytest.mark.parametrize("frames", [0, 1, 3])
def test_the_ground_is_where_objects_stand(cars, camera, path, frames):
    data = scene_data(cars, camera, path[:frames])
    lowest = [thing.vertices_in_world[:, 2].min() for thing in cars.objects]
    assert data["ground"] + data["origin"][2] == pytest.approx(np.median(lowest))
    assert np.isfinite(scene_data(Map(()), camera, path[:frames])["ground"])


def test_what_is_not_known_is_left_out(make_car, camera, path):
    thing = make_car(1, 5.0, 0.0, vertex_sigma_m=None, vertex_observed=None)
    packed = scene_data(Map((thing,)), camera, path)["objects"][0]
    assert packed["sigma"] is None
    assert packed["seen"] is None
