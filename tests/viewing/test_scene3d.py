import base64
from dataclasses import replace

import numpy as np
import pytest

from meshslam.geometry import Pose
from meshslam.maps import Map
from meshslam.viewing import TrueObject
from meshslam.viewing.page_data import PATH_POINTS, page_data
from meshslam.viewing.scene3d import UNIT_M, WIRE_M, ground_height_m, scene_data, scene_origin, thinned_edges


def unpack(text, kind, columns=1):
    return np.frombuffer(base64.b64decode(text), np.dtype(kind).newbyteorder("<")).reshape(-1, columns)


def in_world(packed, origin):
    place = np.array(packed["matrix"]).reshape(3, 4)
    return UNIT_M * unpack(packed["vertices"], "i2", 3) @ place[:, :3].T + place[:, 3] + origin


def data_of(context):
    return scene_data(context, scene_origin(context.map, context.world_from_camera))


def test_meshes_come_back_within_half_a_millimetre(context):
    data = data_of(context)
    assert len(data["objects"]) == len(context.map)
    for packed, thing in zip(data["objects"], context.map.objects, strict=True):
        assert np.abs(in_world(packed, data["origin"]) - thing.vertices_in_world).max() < 1e-3
        np.testing.assert_array_equal(unpack(data["faces"][packed["faces"]], "u4", 3), thing.faces)
        sigma = unpack(packed["sigma"], "u1")[:, 0] / 1000
        np.testing.assert_allclose(sigma, np.minimum(thing.vertex_sigma_m, 0.255), atol=6e-4)
        np.testing.assert_array_equal(unpack(packed["seen"], "u1")[:, 0] > 0, thing.vertex_observed)


def test_equal_topologies_and_means_are_kept_once(context, make_car):
    data = data_of(context)
    assert (len(data["faces"]), len(data["means"])) == (1, 1)
    other = make_car(99, 5.0, 5.0, faces=context.map.objects[0].faces[::-1])
    assert len(data_of(replace(context, map=Map((*context.map.objects, other))))["faces"]) == 2


def test_the_first_estimate_is_beside_the_instance(context, car):
    data = data_of(context)
    for packed, thing in zip(data["objects"], context.map.objects, strict=True):
        first = {"matrix": packed["first"]["matrix"], "vertices": data["means"][packed["first"]["mean"]]}
        expected = thing.world_from_object.transform(car.vertices)
        assert np.abs(in_world(first, data["origin"]) - expected).max() < 1e-3
    assert "first" not in data_of(replace(context, stages=None))["objects"][0]


def test_a_wire_keeps_the_shape_and_few_edges(car):
    vertices, edges = thinned_edges(car.vertices, car.faces)
    assert len(vertices) < len(car.vertices)
    assert (edges[:, 0] < edges[:, 1]).all()
    assert len(np.unique(edges, axis=0)) == len(edges)
    assert np.abs(np.ptp(vertices, axis=0) - car.dimensions).max() < 2 * WIRE_M
    nearest = np.linalg.norm(vertices[:, None] - car.vertices[None], axis=2).min(axis=1)
    assert nearest.max() < WIRE_M


def test_true_meshes_are_where_they_are(context, make_car):
    thing = make_car(50, 12.0, 3.0, 0.4)
    true = TrueObject(50, thing.world_from_object, thing.vertices, thing.faces)
    data = data_of(replace(context, true_objects=(true,)))
    wire = in_world(data["truth"][0], data["origin"])
    assert np.linalg.norm(wire.mean(axis=0) - thing.world_from_object.translation) < 0.3
    assert unpack(data["truth"][0]["edges"], "u2", 2).max() < len(wire)


def test_the_path_is_whole_or_thinned(context):
    data = page_data(context, [])
    expected = np.array([pose.translation for pose in context.world_from_camera])
    origin = data["scene"]["origin"]
    np.testing.assert_allclose(unpack(data["paths"][0]["points"], "f4", 3) + origin, expected, atol=1e-5)
    long = tuple(Pose(np.eye(3), np.array([0.5 * i, 0.0, 1.0])) for i in range(2 * PATH_POINTS + 5))
    count = len(long)
    data = page_data(
        replace(context, frame_ids=tuple(range(count)), world_from_camera=long, times_s=np.arange(count)), []
    )
    points = unpack(data["paths"][0]["points"], "f4", 3)
    assert PATH_POINTS / 2 < len(points) <= PATH_POINTS + 1
    assert points[-1][0] + data["scene"]["origin"][0] == long[-1].translation[0]


def test_far_from_the_origin_nothing_is_lost(context, make_car):
    far = np.array([4.5e6, 5e5, 100.0])
    poses = tuple(Pose(np.eye(3), far + [i, 0.0, 1.6]) for i in range(5))
    scene = Map((make_car(1, far[0], far[1]),))
    there = replace(context, map=scene, world_from_camera=poses, frame_ids=tuple(range(5)), times_s=np.arange(5.0))
    steps = np.diff(unpack(page_data(there, [])["paths"][0]["points"], "f4", 3), axis=0)
    np.testing.assert_allclose(steps, np.tile([1.0, 0.0, 0.0], (4, 1)), atol=1e-4)


@pytest.mark.parametrize("frames", [0, 1, 3])
def test_the_ground_is_where_objects_stand(cars, path, frames):
    points = np.array([pose.translation for pose in path[:frames]]).reshape(-1, 3)
    lowest = [thing.vertices_in_world[:, 2].min() for thing in cars.objects]
    assert ground_height_m(cars, points) == pytest.approx(np.median(lowest))
    assert np.isfinite(ground_height_m(Map(()), points))


def test_what_is_not_known_is_left_out(context, make_car):
    thing = make_car(1, 5.0, 0.0, vertex_sigma_m=None, vertex_observed=None, pose_covariance=None)
    packed = data_of(replace(context, map=Map((thing,))))["objects"][0]
    for name in ("sigma", "seen", "ellipse", "position_sigma", "seen_share", "error"):
        assert packed[name] is None
