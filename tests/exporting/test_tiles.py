"""The map in tiles, and OGC 3D Tiles."""

import json
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pymap3d
import pytest
import trimesh

from meshslam.exporting import GeoOrigin, export_content
from meshslam.geometry import Pose
from meshslam.maps import Map, TiledMap
from meshslam.runs import export_run
from tests.gltf_validator import PACKAGES, validated

Y_UP_TO_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # as every reader of 3D Tiles does
IDENTITY = np.eye(4)
ORIGIN = GeoOrigin(49.011, 8.416, 110.0, 30.0)


@pytest.fixture
def spread(run):
    """The run with its cars in five tiles, some far away."""
    cars, places = run.scene.objects, [(12, 3), (170, 3), (-40, 260), (2000, -710), (2050, -720)]
    moved = (
        replace(cars[i % 3], id=i, world_from_object=Pose.from_yaw(0.3 * i, np.array([*place, 0.7])))
        for i, place in enumerate(places)
    )
    return replace(run, scene=Map(tuple(moved)))


def nodes(node, world_from_parent=IDENTITY):
    """Every node of a tileset with its place in the world, from the root down."""
    own = np.array(node.get("transform", IDENTITY.ravel()), float).reshape(4, 4).T
    world_from_node = world_from_parent @ own
    yield node, world_from_node
    for child in node.get("children", []):
        yield from nodes(child, world_from_node)


def box_of(node, world_from_node):
    middle, *half = np.array(node["boundingVolume"]["box"]).reshape(4, 3)
    corners = np.array([middle + (2 * np.array(s) - 1) @ half for s in np.ndindex(2, 2, 2)])
    return trimesh.transform_points(corners, world_from_node)


def tileset(folder):
    return json.loads((folder / "tileset.json").read_text())


def test_tiles_of_a_run_are_its_map_in_tiles(run, tmp_path):
    assert export_content(run, "tiles", tmp_path / "city") == ()
    city = TiledMap.open(tmp_path / "city")
    assert sorted(city) == list(run.scene)
    for thing in run.scene.objects:
        assert np.abs(city[thing.id].vertices_in_world - thing.vertices_in_world).max() < 1e-3


def test_every_car_stands_where_it_is_and_within_its_boxes(spread, tmp_path):
    (note,) = export_content(spread, "3dtiles", tmp_path / "out")
    assert "--origin" in note
    document, found = tileset(tmp_path / "out"), {}
    assert document["asset"] == {"version": "1.1"}
    for node, world_from_node in nodes(document["root"]):
        if "content" in node:
            scene = trimesh.load_scene(tmp_path / "out" / node["content"]["uri"])
            corners = box_of(node, world_from_node)
            for name in scene.graph.nodes_geometry:
                transform, geometry = scene.graph[name]
                points = trimesh.transform_points(scene.geometry[geometry].vertices, Y_UP_TO_Z_UP @ transform)
                found[int(name.split("_")[1])] = points = trimesh.transform_points(points, world_from_node)
                assert (corners.min(0) <= points.min(0) + 1e-3).all()
                assert (corners.max(0) >= points.max(0) - 1e-3).all()
    for thing in spread.scene.objects:
        given = thing.vertices_in_world
        assert np.abs(found[thing.id].min(0) - given.min(0)).max() < 1e-3
        assert np.abs(found[thing.id].max(0) - given.max(0)).max() < 1e-3


def test_boxes_hold_their_childrens_and_errors_fall_towards_the_leaves(spread, tmp_path):
    export_content(spread, "3dtiles", tmp_path / "out")
    document = tileset(tmp_path / "out")
    assert len([node for node, _ in nodes(document["root"]) if "content" in node]) == 4
    for node, at in nodes(document["root"]):
        outer = box_of(node, at)
        for child in node.get("children", []):
            ((_, inside), *_) = nodes(child, at)
            inner = box_of(child, inside)
            assert (outer.min(0) <= inner.min(0) + 1e-6).all()
            assert (outer.max(0) >= inner.max(0) - 1e-6).all()
            assert child["geometricError"] < node["geometricError"]


def test_each_leaf_is_without_fault_to_the_validator_of_gltf(spread, tmp_path):
    export_content(spread, "3dtiles", tmp_path / "out")
    files = sorted((tmp_path / "out" / "tiles").glob("*.glb"))
    assert len(files) == 4
    assert [validated(file) for file in files] == [[]] * 4


def test_with_an_origin_the_tileset_stands_on_the_earth(spread, tmp_path):
    assert export_content(spread, "3dtiles", tmp_path / "out", ORIGIN) == ()
    ((_, earth_from_world), *_) = nodes(tileset(tmp_path / "out")["root"])
    for thing in spread.scene.objects:
        place = thing.world_from_object.translation
        latitude, longitude, height_m = pymap3d.ecef2geodetic(*(earth_from_world @ [*place, 1.0])[:3])
        told = ORIGIN.longitude_latitude(place[None])[0]
        assert np.abs(np.array([longitude, latitude]) - told).max() < 1e-6
        assert height_m == pytest.approx(ORIGIN.height_m + place[2], abs=0.5)  # the earth is round
    assert np.linalg.det(earth_from_world[:3, :3]) == pytest.approx(1.0)


def test_a_map_in_tiles_is_exported_as_the_run_that_it_came_from(spread, tmp_path):
    export_content(spread, "tiles", tmp_path / "city")
    written, _ = export_run(tmp_path / "city", ["3dtiles", "ply"], tmp_path / "on")
    export_content(spread, "3dtiles", tmp_path / "direct")
    names = {p.relative_to(written["3dtiles"]) for p in written["3dtiles"].rglob("*")}
    assert names == {p.relative_to(tmp_path / "direct") for p in (tmp_path / "direct").rglob("*")}
    assert len(trimesh.load(written["ply"], process=False).vertices) == 5 * 642


def test_other_projects_tools_read_the_tileset(spread, tmp_path):
    tool = PACKAGES / "node_modules" / ".bin" / "3d-tiles-tools"
    if not tool.exists() or shutil.which("node") is None:
        pytest.skip("3d-tiles-tools is not in .node: npm install --prefix .node 3d-tiles-tools@0.5.4 (225 MB)")
    export_content(spread, "3dtiles", tmp_path / "out")
    command = [tool, "convert", "-i", tmp_path / "out" / "tileset.json", "-o", tmp_path / "packed.3tz"]
    subprocess.run([str(word) for word in command], check=True, capture_output=True)
    command = [tool, "convert", "-i", tmp_path / "packed.3tz", "-o", tmp_path / "again"]
    subprocess.run([str(word) for word in command], check=True, capture_output=True)
    assert tileset(tmp_path / "again") == tileset(tmp_path / "out")
    assert len(list((tmp_path / "again" / "tiles").glob("*.glb"))) == 4
