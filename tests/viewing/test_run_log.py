"""What a run tells its log, read back from the files by the viewers' own libraries."""

import io
import subprocess
import sys
import textwrap
import threading
from dataclasses import replace

import cv2
import numpy as np
import pytest
import rerun as rr
import simplejpeg
from mcap.reader import NonSeekingReader, make_reader
from mcap_protobuf.decoder import DecoderFactory
from rerun.chunk import RrdReader

from meshslam.errors import ConfigError
from meshslam.geometry import Pose, render
from meshslam.maps import Map, object_colour
from meshslam.viewing import LogTargets, McapLog, OpenedLog, RerunLog, log_finished_run, open_run_log, write_recording
from meshslam.viewing.log_shapes import CHANGED_M, _before, mesh_outlines, position_ellipsoids, vertex_colours
from meshslam.viewing.overlay import mask_contours

COVARIANCE = np.diag([0.04, 0.01, 0.0025, 1e-4, 1e-4, 1e-4])
TURNED = Pose.from_yaw(0.3, np.array([5.0, -2.0, 1.0]))


@pytest.fixture(autouse=True)
def strict():
    """Wrong data are errors, not warnings."""
    before = rr.strict_mode()
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(before)


@pytest.fixture
def finished(context):
    return replace(context, covariances=np.tile(COVARIANCE, (len(context.frame_ids), 1, 1)))


def rows_of(file):
    """Rows of a recording for Rerun: by entity a list of columns by name, one dictionary a row."""
    found = {}
    for chunk in RrdReader(file).stream():
        batch = chunk.to_record_batch()
        for i in range(chunk.num_rows):
            cells = {name: batch.column(name)[i] for name in batch.schema.names}
            row = {name: cell.value if hasattr(cell, "value") else cell.as_py() for name, cell in cells.items()}
            row |= {"types": {name: str(cell.type) for name, cell in cells.items()}}
            found.setdefault(str(chunk.entity_path), []).append(row | {"is_static": chunk.is_static})
    return found


def messages_of(content):
    """Messages of an MCAP file by topic: times in ns, and the decoded messages."""
    found, decoders = {}, DecoderFactory()
    for schema, channel, message in make_reader(io.BytesIO(content)).iter_messages(log_time_order=False):
        decode = decoders.decoder_for(channel.message_encoding, schema) or bytes  # JSON as it is
        found.setdefault(channel.topic, []).append((message.log_time, decode(message.data)))
    return found


def pose_of(message):
    p, q = message.position, message.orientation
    return Pose.from_quaternion(np.array([q.x, q.y, q.z, q.w]), np.array([p.x, p.y, p.z]), order="xyzw")


def test_a_recording_for_rerun_holds_every_car_frame_and_mesh(finished, tmp_path):
    file = tmp_path / "run.rrd"
    write_recording(finished, file)
    rows = rows_of(file)
    for thing in finished.map.objects:
        [row] = rows[f"/world/result/objects/car_{thing.id}"]
        assert row["is_static"]
        np.testing.assert_allclose(row["Mesh3D:vertex_positions"], thing.vertices_in_world, atol=1e-4)
        np.testing.assert_array_equal(row["Mesh3D:triangle_indices"], thing.faces)
        r, g, b = object_colour(thing.id).tolist()
        assert set(row["Mesh3D:vertex_colors"]) == {r << 24 | g << 16 | b << 8 | 255}
    assert sum(name.startswith("/world/result/objects/") for name in rows) == len(finished.map)
    poses = {row["frame"]: row for row in rows["/world/camera"]}
    assert tuple(poses) == finished.frame_ids
    for frame, pose in zip(finished.frame_ids, finished.world_from_camera, strict=True):
        np.testing.assert_allclose(poses[frame]["Transform3D:translation"][0], pose.translation, atol=1e-5)
        np.testing.assert_allclose(poses[frame]["Transform3D:mat3x3"][0], pose.rotation.T.ravel(), atol=1e-6)
    images = [row for row in rows["/world/camera/image"] if row.get("EncodedImage:blob")]
    assert len(images) == len(finished.frame_ids)
    assert [row["frame"] for row in rows["/world/camera/image/masks"]] == list(finished.frame_ids)
    [line] = rows["/world/result/path"]
    assert len(line["LineStrips3D:strips"][0]) == len(finished.frame_ids)
    [ellipsoids] = rows["/world/result/covariances"]
    assert len(ellipsoids["Ellipsoids3D:half_sizes"]) == len(finished.frame_ids)
    np.testing.assert_allclose(sorted(ellipsoids["Ellipsoids3D:half_sizes"][0]), [0.15, 0.3, 0.6], atol=1e-6)


def test_masks_and_meshes_are_in_the_pixels_of_the_image(finished, tmp_path):
    file = tmp_path / "run.rrd"
    write_recording(finished, file)
    rows, camera = rows_of(file), finished.camera
    masks = {row["frame"]: row["SegmentationImage:buffer"][0] for row in rows["/world/camera/image/masks"]}
    drawn = np.frombuffer(bytes(masks[5]), np.uint16).reshape(camera.height, camera.width)
    [context] = [row for row in rows["/world/camera/image"] if row.get("AnnotationContext:context")]
    assert context["is_static"]  # viewers do not follow another kind
    infos = [entry["class_description"]["info"] for entry in context["AnnotationContext:context"][0]]
    colours = {(i["color"] >> 24, i["color"] >> 16 & 255, i["color"] >> 8 & 255): i["id"] for i in reversed(infos)}
    for detection in finished.found_at(5):
        inside = drawn[detection.mask() > 0]
        assert (inside == colours[tuple(object_colour(detection.track_id))]).mean() > 0.9  # nearer ones may lie over it
    [lens] = [row for row in rows["/world/camera/image"] if row.get("Pinhole:image_from_camera")]
    K = np.array(lens["Pinhole:image_from_camera"][0]).reshape(3, 3).T
    np.testing.assert_allclose(K[:2, 2], [camera.cx + 0.5, camera.cy + 0.5], atol=1e-4)  # centres at halves


def test_an_mcap_file_holds_every_car_frame_and_mesh(finished, tmp_path):
    file = tmp_path / "run.mcap"
    log = McapLog(file)
    log.begin("drive", finished.camera)
    log_finished_run(log, finished)
    log.close()
    found, count = messages_of(file.read_bytes()), len(finished.frame_ids)
    [(at, update)] = found["/result/objects"]
    assert at == 10_000_000_000  # it shows from the first frame on
    meshes = {entity.id: entity for entity in update.entities if entity.triangles}
    assert set(meshes) == {f"car_{thing.id}" for thing in finished.map.objects}
    for thing in finished.map.objects:
        [triangles] = meshes[f"car_{thing.id}"].triangles
        points = np.array([(p.x, p.y, p.z) for p in triangles.points])
        np.testing.assert_allclose(pose_of(triangles.pose).transform(points), thing.vertices_in_world, atol=1e-9)
        assert list(triangles.indices) == thing.faces.ravel().tolist()
        assert len(triangles.colors) == len(points)
    [path] = [entity for entity in update.entities if entity.id == "path"]
    assert len(path.lines[0].points) == len(path.spheres) == count
    times = [round(1e9 * t) for t in finished.times_s]
    for topic in ("/camera/image", "/camera/calibration", "/camera/pose", "/camera/annotations"):
        assert [at for at, _ in found[topic]] == times, topic
    assert all(
        message.timestamp.seconds * 10**9 + message.timestamp.nanos == at for at, message in found["/camera/pose"]
    )
    cameras = [message for _, message in found["/tf"] if message.child_frame_id == "camera"]
    assert len(cameras) == count
    for transform, (_, placed), pose in zip(cameras, found["/camera/pose"], finished.world_from_camera, strict=True):
        np.testing.assert_allclose(pose_of(placed.pose).matrix, pose.matrix, atol=1e-9)
        for part, other in (("translation", "position"), ("rotation", "orientation")):
            assert str(getattr(transform, part)) == str(getattr(placed.pose, other))
    _, calibration = found["/camera/calibration"][0]
    np.testing.assert_allclose(np.array(calibration.K).reshape(3, 3), finished.camera.matrix)
    image = simplejpeg.decode_jpeg(found["/camera/image"][3][1].data, "BGR")
    assert image.shape == finished.read_image(3).shape
    assert all(len(message.points) >= len(finished.map) for _, message in found["/camera/annotations"])
    [(_, cloud)] = found["/result/points"]
    assert len(cloud.data) == cloud.point_stride * sum(len(thing.vertices) for thing in finished.map.objects)


def tell_live(log, context):
    """Objects that come, change and go, frames without and with poses, then the result in another world."""
    first, second, third = context.map.objects
    moved = replace(second, world_from_object=TURNED @ second.world_from_object)
    shaped = replace(second, vertices=second.vertices * 1.02)
    hardly = replace(first, vertices=first.vertices + CHANGED_M / 4)
    image = context.read_image(0)
    log.begin("drive", context.camera)
    log.objects([first])  # before there is a frame
    log.frame(0, 1.0, None, None, image, context.found_at(0))
    log.frame(
        0, 1.0, context.world_from_camera[0], COVARIANCE, image, objects=[first, second], timings_ms={"slam": 7.5}
    )
    log.frame(1, 1.1, context.world_from_camera[1], COVARIANCE, lambda: image, objects=[hardly, moved])
    log.objects([hardly, shaped, third])
    log.objects([hardly, third])
    log.result(context.map, context.frame_ids, context.times_s, context.world_from_camera, None, TURNED)
    log.close()


def test_live_objects_appear_change_and_vanish(context, tmp_path):
    tell_live(open_run_log(LogTargets(rrd=tmp_path / "run.rrd", mcap=tmp_path / "run.mcap")), context)
    rows, found = rows_of(tmp_path / "run.rrd"), messages_of((tmp_path / "run.mcap").read_bytes())
    told = {name: rows[f"/world/live/objects/car_{name}"] for name in (3, 7, 12)}
    meshes = {name: sum(bool(row.get("Mesh3D:vertex_positions")) for row in found) for name, found in told.items()}
    places = {name: sum(bool(row.get("Transform3D:translation")) for row in found) for name, found in told.items()}
    assert meshes == {3: 1, 7: 2, 12: 1}  # a mesh that moved is not told again
    assert places == {3: 1, 7: 3, 12: 1}
    assert sum("Clear:is_recursive" in row for row in told[7]) == 1
    assert len([row for row in rows["/world/camera/image"] if row.get("EncodedImage:blob")]) == 2  # each once
    assert len(rows["/world/live/path"]) == len(rows["/world/live/covariance"]) == 2
    assert [row["Scalars:scalars"] for row in rows["/timings/slam"]] == [[7.5]]
    [live] = rows["/world/live"]
    np.testing.assert_allclose(live["Transform3D:translation"][0], TURNED.translation, atol=1e-6)
    entities = [e.id for _, update in found["/live/objects"] for e in update.entities]
    assert {name: entities.count(f"car_{name}") for name in (3, 7, 12)} == {3: 1, 7: 3, 12: 1}
    assert [d.id for _, update in found["/live/objects"] for d in update.deletions] == ["car_7"]
    worlds = [message for _, message in found["/tf"] if message.child_frame_id == "live"]
    assert [w.translation.x for w in worlds] == [0.0, 5.0]
    assert len(found["/camera/image"]) == 2
    assert [data for _, data in found["/timings"]] == [b'{"slam": 7.5}']


def test_times_of_a_clock_are_dates_and_times_below_zero_begin_at_zero(context, tmp_path):
    for begin_s, kind in ((1.5e9, "timestamp"), (3.0, "duration")):
        write_recording(replace(context, times_s=begin_s + context.times_s), tmp_path / f"{kind}.rrd")
        row = rows_of(tmp_path / f"{kind}.rrd")["/world/camera"][1]
        assert row["types"]["time"].startswith(kind)
        assert row["time"] == round(1e9 * (begin_s + context.times_s[1]))
    log = McapLog(tmp_path / "run.mcap")
    log.begin("drive", context.camera)
    log_finished_run(log, replace(context, times_s=context.times_s - 12.0))
    log.close()
    times = [at for at, _ in messages_of((tmp_path / "run.mcap").read_bytes())["/camera/pose"]]
    np.testing.assert_allclose(times, 1e8 * np.arange(len(times)), atol=2)


KILLED = """
    import os, signal, sys
    from pathlib import Path
    import numpy as np
    from meshslam.geometry import Camera, Pose
    from meshslam.viewing import LogTargets, open_run_log
    rng, log = np.random.default_rng(0), open_run_log(LogTargets(rrd=Path("run.rrd"), mcap=Path("run.mcap")))
    log.begin("drive", Camera(320, 240, 200.0, 200.0, 160.0, 120.0))
    for i in range(20):
        image = rng.integers(0, 255, (240, 320, 3), dtype=np.uint8)
        log.frame(i, 0.1 * i, Pose.identity(), None, image)
    while not log._calls.empty():
        pass
    import time; time.sleep(1.0)
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_killed_process_leaves_readable_files(tmp_path):
    ended = subprocess.run([sys.executable, "-c", textwrap.dedent(KILLED)], cwd=tmp_path, check=False, timeout=60)
    assert ended.returncode == -9
    rr.set_strict_mode(False)  # the reader warns that the file has no footer
    with pytest.warns(rr.error_utils.RerunWarning, match="no footer"):
        rows = rows_of(tmp_path / "run.rrd")
    assert len([row for row in rows["/world/camera/image"] if row.get("EncodedImage:blob")]) >= 18
    reader = NonSeekingReader(io.BytesIO((tmp_path / "run.mcap").read_bytes()))
    kept = []
    with pytest.raises(Exception, match=r".*"):  # the file ends without its index
        kept.extend(c.topic for _, c, _ in _whole(reader, kept))
    assert kept.count("/camera/image") >= 10


def _whole(reader, kept):
    for row in reader.iter_messages(log_time_order=False):
        kept.append(row[1].topic)
        yield row


class Noted:
    """A log that notes what it is told; it fails at a frame."""

    colouring = "id"

    def __init__(self, fails_at=None):
        self.frames, self.closed, self.fails_at, self.threads = [], 0, fails_at, set()

    def begin(self, title, camera):
        self.title = title

    def frame(self, number, *_):
        if number == self.fails_at:
            raise OSError(28, "No space left on device")
        self.threads.add(threading.get_ident())
        self.frames.append(number)

    def close(self):
        self.closed += 1


def test_a_log_that_fails_is_told_once_and_the_others_go_on():
    said, bad, good = [], Noted(fails_at=3), Noted()
    log = OpenedLog([("a.rrd", bad), ("b.mcap", good)], said.append)
    for number in range(6):
        log.frame(number, 0.1 * number)
    log.close()
    log.close()
    assert (bad.frames, good.frames) == ([0, 1, 2], list(range(6)))
    assert (bad.closed, good.closed) == (1, 1)
    assert said == list(log.failures)
    assert "a.rrd: nothing more is logged" in said[0]
    assert "No space left" in said[0]
    with pytest.raises(ConfigError, match="closed"):
        log.frame(7, 0.7)


def test_threads_may_share_a_log_and_images_may_be_used_again():
    noted, image = Noted(), np.zeros((4, 4, 3), np.uint8)
    seen = []
    noted.frame = lambda number, time_s, pose, covariance, image, *_: seen.append((number, image))
    log = OpenedLog([("a", noted)])

    def tell(first):
        for number in range(first, first + 50):
            log.frame(number, 0.0, image=image)

    tellers = [threading.Thread(target=tell, args=(first,)) for first in (0, 100, 200)]
    [teller.start() for teller in tellers]
    [teller.join() for teller in tellers]
    image[:] = 255
    log.close()
    assert sorted(number for number, _ in seen) == [*range(50), *range(100, 150), *range(200, 250)]
    assert not any(kept.any() for _, kept in seen)


def test_wrong_uses_are_told_before_anything_is_written(tmp_path, monkeypatch):
    there, display = tmp_path / "there.rrd", "meshslam.viewing.opened_log.has_display"
    there.write_bytes(b"kept")
    for targets, message in (
        (LogTargets(view=True, serve=True), "--view and --serve: give one"),
        (LogTargets(rrd=tmp_path / "none" / "a.rrd"), "there is no folder .*none: make it"),
        (LogTargets(mcap=tmp_path / "a.bag"), r"let it end with \.mcap"),
        (LogTargets(rrd=there), "the file is there: .*--overwrite"),
    ):
        with pytest.raises(ConfigError, match=message):
            open_run_log(targets)
    (tmp_path / "folder.mcap").mkdir()
    with pytest.raises(ConfigError, match="is a folder"):
        open_run_log(LogTargets(mcap=tmp_path / "folder.mcap"), overwrite=True)
    monkeypatch.setattr(display, lambda: False)
    with pytest.raises(ConfigError, match=r"no display .*--serve.*--rrd"):
        open_run_log(LogTargets(view=True))
    open_run_log(LogTargets(rrd=there, mcap=tmp_path / "new.mcap"), overwrite=True).close()
    assert there.read_bytes() == b"kept"  # until a run begins
    assert not (tmp_path / "new.mcap").exists()


@pytest.mark.parametrize(
    ("missing", "targets", "extra"),
    [("rerun", {"view": True}, "rerun"), ("rerun", {"serve": True}, "rerun"), ("mcap", {"mcap": "a.mcap"}, "foxglove")],
)
def test_a_missing_package_is_told_with_what_to_install(missing, targets, extra, tmp_path, monkeypatch):
    found = __import__("importlib.util").util.find_spec
    monkeypatch.setattr("importlib.util.find_spec", lambda name, *a: None if name == missing else found(name, *a))
    given = {key: tmp_path / value if isinstance(value, str) else value for key, value in targets.items()}
    with pytest.raises(ConfigError, match=rf"pip install 'meshslam\[{extra}\]'"):
        open_run_log(LogTargets(**given))


def test_colours_by_sigma_follow_the_sigma(make_car):
    thing = make_car(1, 5.0, 0.0)
    count = len(thing.vertices)
    graded = replace(thing, vertex_sigma_m=np.geomspace(0.01, 0.3, count))
    brightness = vertex_colours(graded, "sigma").astype(float) @ [0.299, 0.587, 0.114]
    assert (np.diff(brightness) > -2.0).all()
    assert brightness[-1] > brightness[0] + 100
    by_pose = vertex_colours(replace(thing, vertex_sigma_m=None), "sigma")
    assert len(np.unique(by_pose, axis=0)) == 1
    unknown = vertex_colours(replace(thing, vertex_sigma_m=None, pose_covariance=None), "sigma")
    assert np.ptp(unknown, axis=1).max() == 0  # grey
    np.testing.assert_array_equal(vertex_colours(graded, "id"), np.tile(object_colour(1), (count, 1)))


def test_ellipsoids_are_where_the_covariance_says_three_sigmas(rng):
    poses = [Pose.exp(rng.normal(size=6)) for _ in range(20)]
    roots = rng.normal(size=(20, 6, 6))
    covariances = roots @ roots.transpose(0, 2, 1)
    found = position_ellipsoids(poses, covariances)
    rows = zip(poses, covariances, found.centres, found.half_sizes_m, found.quaternions_xyzw, strict=True)
    for pose, covariance, centre, half_sizes, quaternion in rows:
        np.testing.assert_allclose(centre, pose.translation)
        in_world = pose.rotation @ covariance[:3, :3] @ pose.rotation.T
        ends = Pose.from_quaternion(quaternion, np.zeros(3), order="xyzw").rotation @ np.diag(half_sizes)
        np.testing.assert_allclose(ends @ ends.T, 9.0 * in_world, rtol=1e-6, atol=1e-9)


def test_outlines_enclose_what_is_visible_of_each_mesh(context):
    camera, pose = context.camera, context.world_from_camera[6]
    things = context.map.objects
    drawn = render(camera, [(pose.inverse() @ t.world_from_object, t.vertices, t.faces) for t in things])
    outlines = mesh_outlines(camera, pose, things)
    for index, thing in enumerate(things):
        mask = (drawn.object_index == index).astype(np.uint8)
        assert (thing.id in outlines) == bool(mask.sum() > 4)
        if thing.id in outlines:
            filled = np.zeros_like(mask)
            cv2.fillPoly(filled, [border.astype(np.int32) for border in outlines[thing.id]], 1)
            assert (filled != mask).sum() <= 0.02 * mask.sum()


def test_an_empty_map_without_images_is_told_too(context, tmp_path):
    empty = replace(context, map=Map(()), read_image=None, detections=replace(context.detections, detections=()))
    tell = [RerunLog(tmp_path / "run.rrd"), McapLog(tmp_path / "run.mcap")]
    for log in tell:
        log.begin("drive", empty.camera)
        log_finished_run(log, empty)
        log.close()
    assert len(rows_of(tmp_path / "run.rrd")["/world/camera"]) == len(empty.frame_ids)
    assert len(messages_of((tmp_path / "run.mcap").read_bytes())["/camera/pose"]) == len(empty.frame_ids)


def test_a_viewer_that_is_gone_is_not_waited_for(context, tmp_path, monkeypatch):
    waited, said = [], []

    def flush(_stream, timeout_sec=1e38):
        waited.append(timeout_sec)
        raise RuntimeError("Flush timed out")

    monkeypatch.setattr(rr.RecordingStream, "flush", flush)
    log = open_run_log(LogTargets(rrd=tmp_path / "run.rrd"), on_failure=said.append)
    log.begin("drive", context.camera)
    log_finished_run(log, context)
    log.close()
    assert max(waited) < 60.0
    assert len(said) == 1
    assert len(rows_of(tmp_path / "run.rrd")["/world/camera"]) == len(context.frame_ids)  # all is there, in spite of it


def test_outlines_of_a_large_map_are_those_of_the_few_cars_in_view(camera, path, make_car):
    """The reference draws all of them."""
    rng = np.random.default_rng(2)
    at = rng.uniform([-60, -60, -3], [120, 60, 3], (150, 3))
    cars = tuple(make_car(1 + k % 7, x, y, yaw) for k, (x, y, yaw) in enumerate(at))
    cars = tuple(replace(one, id=k) for k, one in enumerate(cars))
    eye = path[3].inverse()
    index = render(camera, [(eye @ one.world_from_object, one.vertices, one.faces) for one in cars]).object_index
    found = mesh_outlines(camera, path[3], cars)
    assert len(found) > 5
    assert set(found) <= set(np.unique(index[index >= 0]).tolist())
    for number, borders in found.items():
        for one, other in zip(borders, mask_contours((index == number).astype(np.uint8)), strict=True):
            np.testing.assert_array_equal(one, other)
    assert len(_before(camera, eye, cars)) < 0.6 * len(cars)
    far = tuple(replace(one, world_from_object=Pose.from_yaw(0.0, np.array([900.0, 0.0, 0.8]))) for one in cars)
    assert _before(camera, eye, far) == []  # a straight street of many cars
