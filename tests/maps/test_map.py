import json
import re

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from meshslam.errors import MapError
from meshslam.geometry import Pose
from meshslam.maps import Map, MapObject


def files_of(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_what_is_saved_is_loaded(tmp_path, a_map):
    a_map.save(tmp_path)
    for source in (tmp_path, tmp_path / "map.json"):
        loaded = Map.load(source)
        assert [o.id for o in loaded.objects] == [3, 7, 12]
        for a, b in zip(loaded.objects, a_map.objects, strict=True):
            assert (a.category, a.views, a.first_frame, a.last_frame, a.mask_iou) == (
                b.category,
                b.views,
                b.first_frame,
                b.last_frame,
                b.mask_iou,
            )
            assert np.allclose(a.vertices_in_world, b.vertices_in_world, atol=1e-7)
            assert np.array_equal(a.faces, b.faces)
            assert np.allclose(a.dimensions, b.dimensions, atol=1e-8)
            assert np.array_equal(a.vertex_observed, b.vertex_observed)
            assert (a.vertex_sigma_m is None) == (b.vertex_sigma_m is None)
            assert (a.pose_covariance is None) == (b.pose_covariance is None)
            for name, point in b.keypoints.items():
                assert np.allclose(
                    a.world_from_object.transform(a.keypoints[name]), b.world_from_object.transform(point)
                )


def test_the_same_map_gives_the_same_bytes_in_any_order(tmp_path, a_map):
    a_map.save(tmp_path / "a")
    Map(tuple(reversed(a_map.objects))).save(tmp_path / "b")
    assert files_of(tmp_path / "a") == files_of(tmp_path / "b")
    before = files_of(tmp_path / "a")
    a_map.save(tmp_path / "a")
    assert files_of(tmp_path / "a") == before


def test_noise_below_the_last_digit_does_not_change_the_bytes(tmp_path, make_object):
    thing = make_object(world_from_object=Pose(np.eye(3), np.array([1.0, -1e-13, 0.0]))).recentred()
    Map((thing,)).save(tmp_path)
    text = (tmp_path / "map.json").read_text()
    numbers = re.findall(r"-?\d+\.\d+(?:e-?\d+)?", text)
    assert "-0.0" not in numbers
    assert all(float(number) == round(float(number), 9) for number in numbers)


def test_what_is_in_the_file_is_what_the_formats_say(tmp_path, a_map):
    a_map.save(tmp_path)
    document = json.loads((tmp_path / "map.json").read_text())
    assert (document["format"], document["version"]) == ("meshslam-map", 1)
    first, second, _ = document["objects"]
    assert set(first) == {
        "id",
        "category",
        "world_from_object",
        "dimensions",
        "mesh",
        "views",
        "first_frame",
        "last_frame",
        "mask_iou",
        "keypoints",
        "pose_covariance",
        "vertex_sigma_m",
    }
    assert set(first["vertex_sigma_m"]) == {"median", "p90", "observed_share"}
    assert not {"pose_covariance", "vertex_sigma_m", "mask_iou"} & set(second)
    thing = a_map.objects[0]
    assert first["vertex_sigma_m"]["median"] == pytest.approx(np.median(thing.vertex_sigma_m), abs=1e-8)
    assert first["vertex_sigma_m"]["observed_share"] == pytest.approx(thing.vertex_observed.mean(), abs=1e-8)
    mesh = trimesh.load_mesh(tmp_path / first["mesh"], process=False)
    assert np.abs(mesh.bounds.mean(0)).max() < 1e-8
    assert np.allclose(np.ptp(mesh.vertices, axis=0), first["dimensions"])
    header = (tmp_path / first["mesh"]).read_bytes().split(b"end_header")[0].decode()
    assert "property float sigma_m" in header
    assert "property uchar observed" in header


def test_meshes_of_objects_that_left_the_map_go(tmp_path, a_map):
    a_map.save(tmp_path)
    Map(a_map.objects[:1]).save(tmp_path)
    assert [p.name for p in (tmp_path / "objects").iterdir()] == ["3.ply"]
    Map(()).save(tmp_path)
    assert len(Map.load(tmp_path)) == 0


def test_meshes_of_others_stay(tmp_path, a_map):
    (tmp_path / "objects").mkdir()
    (tmp_path / "objects" / "mine.ply").write_text("mine")
    a_map.save(tmp_path)
    Map(a_map.objects[:1]).save(tmp_path)
    assert {p.name for p in (tmp_path / "objects").iterdir()} == {"3.ply", "mine.ply"}


def test_recentring_keeps_the_object_where_it_is(make_object, rng):
    thing = make_object()
    moved = MapObject(**(vars(thing) | {"vertices": thing.vertices + rng.normal(size=3)}))
    centred = moved.recentred()
    assert np.abs(centred.vertices.max(0) + centred.vertices.min(0)).max() < 1e-9
    assert np.allclose(centred.vertices_in_world, moved.vertices_in_world)
    before = moved.world_from_object.transform(moved.keypoints["a"])
    assert np.allclose(centred.world_from_object.transform(centred.keypoints["a"]), before)


def test_recentring_carries_the_covariance_of_a_point(make_object, rng):
    """The covariance of where a point of the object is in the world does not depend on the frame's origin."""
    thing = make_object()
    moved = MapObject(**(vars(thing) | {"vertices": thing.vertices + np.array([0.5, -0.3, 0.8])}))
    centred = moved.recentred()
    point_in_world = rng.normal(size=3)

    def spread(item):
        point = item.world_from_object.inverse().transform(point_in_world)
        # column k of d(R Exp(w) p) / dw is e_k x p
        jacobian = item.world_from_object.rotation @ np.column_stack([np.eye(3), np.cross(np.eye(3), point).T])
        return jacobian @ item.pose_covariance @ jacobian.T

    assert np.allclose(spread(centred), spread(moved))


def test_true_objects_are_a_map_too(tmp_path, rng):
    ball = trimesh.creation.icosphere(subdivisions=1)
    (tmp_path / "meshes").mkdir()
    ball.export(tmp_path / "meshes" / "001.ply")
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_euler("z", 1.0).as_matrix(), [4, 5, 6]
    entry = {"id": 1, "category": "car", "world_from_object": pose.tolist(), "dimensions": [2, 2, 2], "car": "x"}
    (tmp_path / "objects.json").write_text(json.dumps({"objects": [entry | {"mesh": "meshes/001.ply"}]}))
    (thing,) = Map.load(tmp_path / "objects.json").objects
    assert (thing.views, thing.mask_iou, thing.vertex_sigma_m) == (0, None, None)
    assert thing.world_from_object.yaw_rad == pytest.approx(1.0)
    assert np.allclose(thing.world_from_object.translation, [4, 5, 6], atol=1e-6)


def edit(folder, **changes):
    file = folder / "map.json"
    document = json.loads(file.read_text())
    document["objects"][1] |= changes
    for key in [key for key, value in changes.items() if value == "drop"]:
        del document["objects"][1][key]
    file.write_text(json.dumps(document))


SCALED = np.diag([2.0, 1.0, 1.0, 1.0]).tolist()
PROBLEMS = {
    "no map": (lambda f: (f / "map.json").unlink(), "map.json: no such map"),
    "half a map": (lambda f: (f / "map.json").write_text('{"objects": ['), "map.json: cannot be read as JSON"),
    "a list": (lambda f: (f / "map.json").write_text("[]"), "map.json: expected an object"),
    "no objects": (lambda f: (f / "map.json").write_text("{}"), "map.json: objects: expected a list"),
    "other version": (
        lambda f: (f / "map.json").write_text('{"version": 2, "objects": []}'),
        "map.json: format:",
    ),
    "no id": (lambda f: edit(f, id="drop"), "map.json: objects[1]: id: key is missing"),
    "no pose": (lambda f: edit(f, world_from_object="drop"), "map.json: object 7: world_from_object: key is missing"),
    "NaN pose": (
        lambda f: edit(f, world_from_object=[[float("nan")] * 4] * 4),
        "object 7: world_from_object: expected",
    ),
    "no rigid pose": (
        lambda f: edit(f, world_from_object=SCALED),
        "object 7: world_from_object: a",
    ),
    "ragged pose": (
        lambda f: edit(f, world_from_object=[[1], [1, 2]]),
        "object 7: world_from_object: exp",
    ),
    "no mesh": (lambda f: (f / "objects" / "7.ply").unlink(), "7.ply: no such mesh"),
    "half a mesh": (lambda f: cut(f / "objects" / "7.ply"), "7.ply: cannot be read as a mesh"),
    "same id": (lambda f: edit(f, id=3), "map.json: a map's objects have different ids"),
    "views": (lambda f: edit(f, views="many"), "object 7: views: expected a whole number"),
    "keypoints": (lambda f: edit(f, keypoints={"a": [1.0]}), "map.json: object 7: keypoints a has shape (1,)"),
    "keypoint list": (lambda f: edit(f, keypoints=[1.0]), "object 7: keypoints: expected names"),
    "covariance": (lambda f: edit(f, pose_covariance=[[1.0]]), "map.json: object 7: pose_covariance has shape (1, 1)"),
    "mask iou": (lambda f: edit(f, mask_iou=1.5), "map.json: object 7: mask_iou is 1.5"),
}


def cut(file):
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 2])


@pytest.mark.parametrize("name", PROBLEMS)
def test_problems_name_file_object_and_key(tmp_path, a_map, name):
    a_map.save(tmp_path)
    damage, message = PROBLEMS[name]
    damage(tmp_path)
    with pytest.raises(MapError) as caught:
        Map.load(tmp_path)
    assert message in str(caught.value)
    assert str(tmp_path) in str(caught.value)


@pytest.mark.parametrize(
    "changes",
    [
        {"vertices": np.full((162, 3), np.nan)},
        {"faces": np.array([[0, 1, 999]])},
        {"faces": np.zeros((0, 3), int)},
        {"vertex_sigma_m": np.ones(3)},
        {"mask_iou": float("nan")},
        {"world_from_object": Pose(np.eye(3), np.array([np.nan, 0, 0]))},
    ],
)
def test_an_object_that_is_none_is_refused(make_object, changes):
    with pytest.raises(MapError, match="object 1: "):
        make_object(**changes)


def test_a_map_opens_no_mesh_outside_its_folder_unless_it_may(tmp_path, a_map):
    a_map.save(tmp_path / "other")
    (tmp_path / "map" / "objects").mkdir(parents=True)
    document = json.loads((tmp_path / "other" / "map.json").read_text())
    document["objects"] = document["objects"][:1]
    mesh, file = tmp_path / "other" / document["objects"][0]["mesh"], tmp_path / "map" / "map.json"
    (tmp_path / "map" / "link.ply").symlink_to(mesh)
    for name in (str(mesh), f"../other/{document['objects'][0]['mesh']}", "link.ply"):
        document["objects"][0]["mesh"] = name
        file.write_text(json.dumps(document))
        with pytest.raises(MapError, match="outside the map's folder: --allow-outside"):
            Map.load(file)
        assert len(Map.load(file, allow_outside=True)) == 1
    (tmp_path / "map" / "loop.ply").symlink_to("loop.ply")
    for name in ("loop.ply", "a\0b"):
        document["objects"][0]["mesh"] = name
        file.write_text(json.dumps(document))
        with pytest.raises(MapError):
            Map.load(file)
