import gc
import io
import tracemalloc

import numpy as np
import pytest
import trimesh

from meshslam.geometry import Pose
from meshslam.maps import Map, Trajectory, object_colour, save_glb, to_glb
from meshslam.maps.gltf import linear, vertex_colours
from tests.gltf_validator import validated


def scene_of(content):
    return trimesh.load_scene(io.BytesIO(content), file_type="glb")


@pytest.fixture
def path():
    return Trajectory(np.arange(30.0), tuple(Pose(np.eye(3), np.array([i, 0.1 * i, 1.65])) for i in range(30)))


def test_everything_stands_where_it_is_with_up_as_y(a_map, path):
    scene = scene_of(to_glb(a_map, path))
    for thing in a_map.objects:
        transform, name = scene.graph[f"car_{thing.id}"]
        drawn = trimesh.transform_points(scene.geometry[name].vertices, transform)
        x, y, z = thing.vertices_in_world.T
        expected = np.stack([x, z, -y], axis=1)
        assert np.allclose(drawn.min(0), expected.min(0), atol=1e-4)
        assert np.allclose(drawn.max(0), expected.max(0), atol=1e-4)
        assert len(drawn) == len(expected)
    transform, name = scene.graph["path"]
    tube = trimesh.transform_points(scene.geometry[name].vertices, transform)
    assert np.abs(tube[:, 1] - 1.65).max() < 0.1
    assert (tube[:, 0].max(), tube[:, 2].min()) == (pytest.approx(29, abs=0.1), pytest.approx(-2.9, abs=0.1))


def test_the_file_is_without_fault_to_the_validator_of_the_format(a_map, path, tmp_path):
    (tmp_path / "map.glb").write_bytes(to_glb(a_map, path))
    assert validated(tmp_path / "map.glb") == []


def test_an_upright_car_stands_upright(make_object):
    thing = make_object(world_from_object=Pose.from_yaw(0.7, np.array([3.0, 4.0, 0.7])))
    scene = scene_of(to_glb(Map((thing,))))
    assert scene.bounds[1][1] - scene.bounds[0][1] == pytest.approx(thing.dimensions[2], abs=1e-5)


def test_colours_tell_objects_apart_and_fade_with_sigma(make_object):
    colours = np.array([object_colour(i) for i in range(1, 30)], float)
    apart = np.linalg.norm(colours[1:] - colours[:-1], axis=1)
    assert apart.min() > 40
    thing = make_object(1, vertex_sigma_m=np.geomspace(0.01, 1.0, 162))
    drawn = vertex_colours(thing)
    assert np.array_equal(drawn[0, :3], object_colour(1))
    assert np.array_equal(drawn[-1, :3], [150, 150, 150])
    assert np.array_equal(vertex_colours(make_object(1, vertex_sigma_m=None))[5, :3], object_colour(1))


def test_the_colours_of_the_file_are_linear(make_object):
    """sRGB's middle grey is a fifth of full light."""
    assert linear(np.array([[0, 118, 255, 7]], np.uint8)).tolist() == [[0, 46, 255, 7]]
    thing = make_object(1, vertex_sigma_m=None)
    (mesh,) = scene_of(to_glb(Map((thing,)))).geometry.values()
    stored = np.asarray(mesh.visual.vertex_colors)[0, :3].astype(float)
    assert np.allclose(stored, 255 * ((object_colour(1) / 255 + 0.055) / 1.055) ** 2.4, atol=1)


def test_the_same_scene_gives_the_same_bytes(a_map, path):
    assert to_glb(a_map, path) == to_glb(a_map, path)


def test_empty_maps_and_standing_cameras_are_drawn(tmp_path, a_map):
    still = Trajectory(np.arange(3.0), (Pose.identity(),) * 3)
    for content in (
        to_glb(Map(())),
        to_glb(Map(()), still),
        to_glb(a_map, Trajectory(np.zeros(1), (Pose.identity(),))),
    ):
        assert np.isfinite(scene_of(content).bounds).all()
    save_glb(tmp_path / "map.glb", a_map, still)
    assert (tmp_path / "map.glb").read_bytes()[:4] == b"glTF"


def test_a_path_straight_up_is_a_tube(a_map):
    climb = Trajectory(np.arange(5.0), tuple(Pose(np.eye(3), np.array([0, 0, float(i)])) for i in range(5)))
    assert np.isfinite(scene_of(to_glb(Map(()), climb)).bounds).all()


def test_of_a_large_map_little_more_than_the_file_is_in_memory(make_object, path, tmp_path):
    """What each further object adds while a map is drawn, and while it is saved, bytes."""
    ball, added = trimesh.creation.icosphere(subdivisions=3), {}
    mesh = {"vertices": np.array(ball.vertices), "faces": np.array(ball.faces)}
    known = {"vertex_sigma_m": np.full(len(ball.vertices), 0.1), "vertex_observed": np.ones(len(ball.vertices), bool)}
    for name, write in (("draw", lambda scene: to_glb(scene, path)), ("save", lambda scene: scene.save(tmp_path))):
        peaks = []
        for count in (5, 25):
            scene = Map(tuple(make_object(k, **mesh, **known) for k in range(1, count + 1)))
            write(scene)  # imports are not counted
            gc.collect()
            gc.freeze()  # what other tests left makes full collections rare, and trimesh's meshes have circles
            tracemalloc.start()
            write(scene)
            peaks.append(tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
            gc.unfreeze()
        added[name] = (peaks[1] - peaks[0]) / 20
    in_file = 28 * len(ball.vertices)  # positions, normals, colours; faces are there once
    assert added["draw"] < 7.5 * in_file
    assert added["save"] < 20_000  # of a mesh nothing: its file has 53,000
