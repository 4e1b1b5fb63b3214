"""Each format, read back by a library that is not ours."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pycolmap
import pymap3d
import pytest
import trimesh
from evo.tools import file_interface
from mcap.reader import make_reader
from pxr import Usd, UsdGeom
from rerun.chunk import RrdReader
from rosbags.highlevel import AnyReader

from meshslam.errors import ConfigError, MapError
from meshslam.exporting import FORMATS, FinishedRun, GeoOrigin, export_content
from meshslam.geometry import Camera, Pose
from meshslam.maps import Map, Trajectory, object_colour
from tests.exporting.conftest import CAMERA, FRAMES
from tests.gltf_validator import validated

ORIGIN = GeoOrigin(49.011, 8.416, 110.0, 30.0)


def exported(run, name, folder, **options):
    target = folder / FORMATS[name].default_name
    export_content(run, name, target, ORIGIN, **options)
    return target


def matrices(path):
    return np.array([pose.matrix for pose in path.world_from_camera])


def test_every_format_has_a_test_here():
    text = "".join(path.read_text(encoding="utf-8") for path in Path(__file__).parent.glob("test_*.py"))
    assert all(f'"{name}"' in text for name in FORMATS)


def test_glb_is_without_fault_to_the_validator_of_the_format(run, tmp_path):
    file = exported(run, "glb", tmp_path)
    assert validated(file) == []
    damaged = tmp_path / "damaged.glb"
    damaged.write_bytes(file.read_bytes().replace(b'"componentType":5126', b'"componentType":5125', 1))
    assert validated(damaged) != []


def test_glb_holds_objects_with_properties_and_a_camera_a_frame(run, tmp_path):
    file = exported(run, "glb", tmp_path)
    scene = trimesh.load_scene(file)
    tree = json.loads(file.read_bytes()[20:].split(b"\x00")[0].partition(b"BIN")[0][: _json_length(file)])
    nodes = {node["name"]: node for node in tree["nodes"] if "name" in node}
    for thing in run.scene.objects:
        transform, name = scene.graph[f"car_{thing.id}"]
        x, y, z = thing.vertices_in_world.T
        drawn = trimesh.transform_points(scene.geometry[name].vertices, transform)
        np.testing.assert_allclose(drawn.mean(axis=0), np.stack([x, z, -y], axis=1).mean(axis=0), atol=1e-4)
        extras = nodes[f"car_{thing.id}"]["extras"]
        assert (extras["id"], extras["category"], extras["views"]) == (thing.id, "car", 5)
        np.testing.assert_allclose(extras["dimensions_m"], thing.dimensions, atol=1e-6)
    cameras = [name for name in nodes if name.startswith("camera_")]
    assert cameras == [f"camera_{frame}" for frame in FRAMES]
    [lens] = tree["cameras"]
    # a point ahead of the camera is ahead of glTF's camera, which looks along -z with y up
    matrix = np.array(nodes["camera_25"]["matrix"]).reshape(4, 4).T
    ahead, up = matrix[:3, :3] @ [0, 0, -1], matrix[:3, :3] @ [0, 1, 0]
    forward = run.path.world_from_camera[5].rotation[:, 2]
    np.testing.assert_allclose(ahead, [forward[0], forward[2], -forward[1]], atol=1e-6)
    np.testing.assert_allclose(up, [0, 1, 0], atol=1e-6)
    assert lens["perspective"]["yfov"] == pytest.approx(2 * np.arctan(70 / 235.0))
    assert lens["perspective"]["aspectRatio"] == pytest.approx(400 / 140 * 235 / 230)


def _json_length(file):
    return int.from_bytes(file.read_bytes()[12:16], "little")


def test_usd_stage_is_z_up_in_metres(run, tmp_path):
    stage = Usd.Stage.Open(str(exported(run, "usd", tmp_path)))
    assert UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    for thing in run.scene.objects:
        prim = stage.GetPrimAtPath(f"/world/car_{thing.id}")
        assert prim.GetAttribute("meshslam:id").Get() == thing.id
        mesh = UsdGeom.Mesh(stage.GetPrimAtPath(f"/world/car_{thing.id}/mesh"))
        moved = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(mesh.GetPrim()))
        points = np.array(mesh.GetPointsAttr().Get()) @ moved[:3, :3] + moved[3, :3]
        np.testing.assert_allclose(points, thing.vertices_in_world, atol=1e-5)
        np.testing.assert_array_equal(np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3), thing.faces)
    # the frustum of the middle frame projects as our camera does
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/world/camera")).GetCamera(5)
    frustum = camera.frustum
    view, projection = np.array(frustum.ComputeViewMatrix()), np.array(frustum.ComputeProjectionMatrix())
    point = run.scene[3].world_from_object.translation
    clip = np.append(point, 1.0) @ view @ projection
    pixel = CAMERA.project(run.path.world_from_camera[5].inverse().transform(point))
    shown = (clip[:2] / clip[3] * [1, -1] + 1) / 2 * [CAMERA.width, CAMERA.height] - 0.5
    np.testing.assert_allclose(shown, pixel, atol=1e-2)


def test_ply_and_obj_stand_in_the_world_and_not_all_at_the_origin(run, tmp_path):
    every = np.concatenate([thing.vertices_in_world for thing in run.scene.objects])
    faces = sum(len(thing.faces) for thing in run.scene.objects)
    ply = trimesh.load_mesh(exported(run, "ply", tmp_path), process=False)
    np.testing.assert_allclose(ply.vertices, every, atol=1e-9)
    assert len(ply.faces) == faces
    columns = ply.metadata["_ply_raw"]["vertex"]["data"]
    assert {int(number) for number in np.unique(columns["object"])} == set(run.scene)
    np.testing.assert_allclose(columns["sigma_m"][:642], run.scene[3].vertex_sigma_m, atol=1e-6)
    np.testing.assert_array_equal(ply.visual.vertex_colors[0, :3], object_colour(3))
    obj = trimesh.load_scene(exported(run, "obj", tmp_path), process=False, split_objects=True)
    assert sum(len(mesh.faces) for mesh in obj.geometry.values()) == faces
    low, high = obj.bounds
    np.testing.assert_allclose([low, high], [every.min(axis=0), every.max(axis=0)], atol=1e-5)


def test_tum_kitti_and_euroc_are_what_evo_reads(run, tmp_path):
    truth = matrices(run.path)
    tum = file_interface.read_tum_trajectory_file(exported(run, "tum", tmp_path))
    np.testing.assert_allclose(tum.poses_se3, truth, atol=1e-8)
    np.testing.assert_allclose(tum.timestamps, run.path.times_s, atol=1e-6)
    kitti = file_interface.read_kitti_poses_file(exported(run, "kitti", tmp_path))
    np.testing.assert_allclose(kitti.poses_se3, np.linalg.inv(truth[0]) @ truth, atol=1e-8)
    file = exported(run, "euroc", tmp_path)
    euroc = file_interface.read_euroc_csv_trajectory(file)
    np.testing.assert_allclose(euroc.poses_se3, truth, atol=1e-8)
    np.testing.assert_allclose(euroc.timestamps, run.path.times_s, atol=1e-6)
    rows = np.loadtxt(file, delimiter=",")
    np.testing.assert_allclose(rows[:, 8:11], run.estimate.velocity_in_world, atol=1e-8)
    np.testing.assert_allclose(rows[:, 14:17], run.estimate.biases[:, :3], atol=1e-8)  # accelerometer last


def test_kitti_labels_put_the_box_where_the_car_is(run, tmp_path):
    """The corners of a label's 3-D box, as KITTI's devkit computes them, are those of the car's own box."""
    folder = exported(run, "kitti-labels", tmp_path)
    assert sorted(path.stem for path in folder.iterdir()) == [f"{frame:06d}" for frame in FRAMES]
    seen = 0
    for index, frame in enumerate(FRAMES):
        for line in (folder / f"{frame:06d}.txt").read_text().splitlines():
            kind, truncated, occluded, *numbers = line.split()
            alpha, x0, y0, x1, y1, height, width, length, *place, rotation_y, score = map(float, numbers)
            assert (kind, occluded, score) == ("Car", "3", 0.9)
            thing = min(run.scene.objects, key=lambda t: abs(t.dimensions[0] - length))
            camera_from_object = run.camera_from_object(index, thing.id)
            turn = np.array(
                [
                    [np.cos(rotation_y), 0, np.sin(rotation_y)],
                    [0, 1, 0],
                    [-np.sin(rotation_y), 0, np.cos(rotation_y)],
                ]
            )
            box = np.array(
                [[sx * length / 2, sy, sz * width / 2] for sx in (-1, 1) for sy in (0, -height) for sz in (-1, 1)]
            )
            corners = box @ turn.T + place
            own = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * thing.dimensions / 2
            expected = camera_from_object.transform(own)
            nearest = np.linalg.norm(corners[:, None] - expected[None], axis=2).min(axis=1)
            assert nearest.max() < 2e-3
            pixels = CAMERA.project(camera_from_object.transform(thing.vertices))
            inside = np.clip([pixels.min(axis=0), pixels.max(axis=0)], 0, [CAMERA.width - 1, CAMERA.height - 1])
            np.testing.assert_allclose([[x0, y0], [x1, y1]], inside, atol=1e-2)
            assert (float(truncated) > 0) == (not np.allclose(inside, [pixels.min(axis=0), pixels.max(axis=0)]))
            towards = np.arctan2(place[0], place[2])
            assert np.cos(alpha - rotation_y + towards) == pytest.approx(1, abs=1e-4)
            seen += 1
    assert seen == len(run.detections.detections)


def test_csv_and_parquet_hold_the_same_tables(run, tmp_path):
    folder = exported(run, "csv", tmp_path)
    with (folder / "objects.csv").open() as file:
        rows = list(csv.DictReader(file))
    table = pyarrow.parquet.read_table(exported(run, "parquet", tmp_path) / "objects.parquet").to_pylist()
    assert [int(row["id"]) for row in rows] == [row["id"] for row in table] == [3, 7, 12]
    for row, typed, thing in zip(rows, table, run.scene.objects, strict=True):
        assert [float(row[f"{axis}_m"]) for axis in "xyz"] == pytest.approx(list(thing.world_from_object.translation))
        assert typed["length_m"] == pytest.approx(thing.dimensions[0])
        assert typed["sigma_yaw_deg"] == pytest.approx(np.degrees(0.02), rel=1e-6)
        assert {name: str(value) for name, value in typed.items()} == row
    path = pyarrow.parquet.read_table(tmp_path / "parquet" / "trajectory.parquet").to_pydict()
    np.testing.assert_allclose([path["x_m"], path["y_m"], path["z_m"]], run.path.positions_in_world.T, atol=1e-8)
    assert path["frame"] == list(FRAMES)
    assert (folder / "trajectory.csv").read_bytes() == run.estimate.to_csv()


def test_rrd_and_mcap_hold_every_car_and_every_image(run, tmp_path):
    image = np.full((CAMERA.height, CAMERA.width, 3), 90, np.uint8)
    shown = run.with_images(lambda _index: image)
    entities = [str(chunk.entity_path) for chunk in RrdReader(exported(shown, "rrd", tmp_path)).stream()]
    assert {f"/world/result/objects/car_{number}" for number in run.scene} <= set(entities)
    with exported(shown, "mcap", tmp_path).open("rb") as file:
        counts = make_reader(file).get_summary()
        topics = {counts.channels[number].topic: n for number, n in counts.statistics.channel_message_counts.items()}
    assert topics["/camera/image"] == len(FRAMES)


def test_a_ros_2_bag_holds_odometry_path_transforms_and_meshes(run, tmp_path):
    folder = exported(run, "ros2bag", tmp_path)
    with AnyReader([folder]) as bag:
        found = {}
        for connection, time_ns, raw in bag.messages():
            found.setdefault(connection.topic, []).append((time_ns, bag.deserialize(raw, connection.msgtype)))
    assert [time_ns for time_ns, _ in found["/meshslam/odometry"]] == run.times_ns
    for i, (time_ns, message) in enumerate(found["/meshslam/odometry"]):
        pose, p, q = run.path.world_from_camera[i], message.pose.pose.position, message.pose.pose.orientation
        read = Pose.from_quaternion(np.array([q.x, q.y, q.z, q.w]), np.array([p.x, p.y, p.z]), order="xyzw")
        np.testing.assert_allclose(read.matrix, pose.matrix, atol=1e-9)
        stamp = message.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == time_ns
        covariance = message.pose.covariance.reshape(6, 6)
        np.testing.assert_allclose(covariance, run.estimate.covariances_in_world[i], atol=1e-12)
    [(_, array)] = found["/meshslam/objects"]
    assert [marker.id for marker in array.markers] == list(run.scene)
    for marker, thing in zip(array.markers, run.scene.objects, strict=True):
        corners = np.array([[p.x, p.y, p.z] for p in marker.points])
        np.testing.assert_allclose(corners, thing.vertices[thing.faces.ravel()], atol=1e-9)
        assert (marker.type, marker.ns, marker.header.frame_id) == (11, "car", "map")
    [(_, path)] = found["/meshslam/path"]
    assert len(path.poses) == len(found["/tf"]) == len(FRAMES)


def test_colmap_projects_as_we_do(run, tmp_path):
    model = pycolmap.Reconstruction(str(exported(run, "colmap", tmp_path)))
    assert sorted(image.name for image in model.images.values()) == [f"{frame:010d}.jpg" for frame in FRAMES]
    for index, frame in enumerate(FRAMES):
        [image] = [image for image in model.images.values() if image.name == f"{frame:010d}.jpg"]
        point = run.scene[7].world_from_object.translation
        ours = CAMERA.project(run.path.world_from_camera[index].inverse().transform(point))
        np.testing.assert_allclose(image.project_point(point) - 0.5, ours, atol=1e-6)
    seen = sum(int(thing.vertex_observed.sum()) for thing in run.scene.objects)
    assert len(model.points3D) == seen
    skewed = replace(run, camera=Camera(400, 140, 230.0, 235.0, 198.0, 62.0, 0.4))
    with pytest.raises(ConfigError, match="skew"):
        export_content(skewed, "colmap", tmp_path / "skewed")
    assert not (tmp_path / "skewed").exists()


def test_geojson_is_on_the_earth_where_it_was_said(run, tmp_path):
    """Its coordinates, back in the local frame, are the footprints, turned by the heading."""
    document = json.loads(exported(run, "geojson", tmp_path).read_text())
    *polygons, line = document["features"]
    turn = np.radians(30.0)

    def local(coordinates):
        longitude, latitude = np.array(coordinates).T
        east, north, _ = pymap3d.geodetic2enu(latitude, longitude, 110.0, 49.011, 8.416, 110.0)
        x = east * np.sin(turn) + north * np.cos(turn)
        return np.stack([x, -east * np.cos(turn) + north * np.sin(turn)], axis=1)

    for feature, thing in zip(polygons, run.scene.objects, strict=True):
        [ring] = feature["geometry"]["coordinates"]
        assert ring[0] == ring[-1]
        footprint = local(ring)
        area = 0.5 * np.sum(footprint[:-1, 0] * footprint[1:, 1] - footprint[1:, 0] * footprint[:-1, 1])
        assert area == pytest.approx(thing.dimensions[0] * thing.dimensions[1], rel=1e-3)  # counter-clockwise
        np.testing.assert_allclose(footprint[:4].mean(axis=0), thing.world_from_object.translation[:2], atol=2e-3)
        assert feature["properties"]["id"] == thing.id
    assert line["geometry"]["type"] == "LineString"
    np.testing.assert_allclose(local(line["geometry"]["coordinates"]), run.path.positions_in_world[:, :2], atol=2e-3)


@pytest.mark.parametrize("name", FORMATS)
def test_a_run_without_objects_uncertainty_and_detections_is_exported_too(run, tmp_path, name):
    bare = FinishedRun("bare", Map(()), run.path, FRAMES, CAMERA)
    target = exported(bare, name, tmp_path)
    assert target.exists()
    if name in ("ply", "obj", "kitti-labels"):
        assert export_content(bare, name, target, overwrite=True)  # a note says that it is empty


@pytest.mark.parametrize("name", FORMATS)
def test_a_run_of_one_frame_is_exported_too(run, tmp_path, name):
    one = Trajectory(run.path.times_s[:1], run.path.world_from_camera[:1])
    assert exported(FinishedRun("one", run.scene, one, FRAMES[:1], CAMERA), name, tmp_path).exists()


@pytest.mark.parametrize("name", sorted(set(FORMATS) - {"rrd"}))
def test_the_same_run_gives_the_same_bytes(run, tmp_path, name):
    first, second = (exported(run, name, tmp_path / place) for place in ("a", "b"))
    files = [first] if first.is_file() else sorted(path for path in first.rglob("*") if path.is_file())
    assert files
    for file in files:
        other = second if first.is_file() else second / file.relative_to(first)
        assert file.read_bytes() == other.read_bytes()


def test_what_is_there_stays_unless_it_is_to_be_replaced(run, tmp_path):
    file = tmp_path / "path.tum"
    file.write_text("mine")
    with pytest.raises(MapError, match="--overwrite"):
        export_content(run, "tum", file)
    assert file.read_text() == "mine"
    export_content(run, "tum", file, overwrite=True)
    assert file.read_bytes() == run.path.to_tum()
    with pytest.raises(MapError, match="is a file"):
        export_content(run, "csv", file, overwrite=True)
    folder = exported(run, "csv", tmp_path)
    (folder / "old").write_text("old")
    export_content(run, "csv", folder, overwrite=True)
    assert sorted(path.name for path in folder.iterdir()) == ["objects.csv", "trajectory.csv"]
    assert not list(tmp_path.glob(".*"))


def test_an_export_that_fails_leaves_nothing_and_replaces_nothing(run, tmp_path, monkeypatch):
    folder = exported(run, "csv", tmp_path)
    before = (folder / "objects.csv").read_bytes()

    def full(*_given):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("meshslam.exporting.csv_tables.trajectory_table", full)
    with pytest.raises(MapError, match="No space left"):
        export_content(replace(run, estimate=None), "csv", folder, overwrite=True)
    assert (folder / "objects.csv").read_bytes() == before
    assert not list(tmp_path.glob(".*"))


def test_unknown_formats_missing_packages_and_origins_are_named(run, tmp_path, monkeypatch):
    with pytest.raises(ConfigError, match=r"--format step: unknown, expected one of glb, usd"):
        export_content(run, "step", tmp_path / "x")
    with pytest.raises(ConfigError, match="--origin LAT,LON"):
        export_content(run, "geojson", tmp_path / "x")
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    with pytest.raises(ConfigError, match=r"pip install 'meshslam\[usd\]'"):
        export_content(run, "usd", tmp_path / "x")


@pytest.mark.parametrize("given", ["", "49", "49,8,1,2,3", "91,0", "0,181", "a,b", "nan,0"])
def test_an_origin_that_is_none_is_said(given):
    with pytest.raises(ConfigError, match="LATITUDE,LONGITUDE"):
        GeoOrigin.parse(given)
