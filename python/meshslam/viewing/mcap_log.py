"""A run as an MCAP file with Foxglove's schemas, for Foxglove and for Rerun; needs the extra `foxglove`."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from meshslam.errors import ConfigError
from meshslam.geometry import Bytes, Camera, Floats, Pose
from meshslam.maps import Map, MapObject, object_colour
from meshslam.perception import Detection
from meshslam.viewing.log_shapes import (
    KnownObjects,
    detection_colour,
    mesh_outlines,
    position_ellipsoids,
    vertex_colours,
)
from meshslam.viewing.overlay import mask_contours
from meshslam.viewing.run_log import Colouring, LoggedImage

CHUNK_BYTES = 256 * 1024  # what a killed process loses at most
JPEG_QUALITY = 80
WORLD, CAMERA, LIVE = "world", "camera", "live"  # frames of Foxglove
MASK_OPACITY, OUTLINE_PX = 0.3, 2.0
PATH_RGB, PATH_WIDTH_M = (235, 110, 20), 0.1
NANOSECONDS = 10**9
_PACKAGES = ("foxglove_schemas_protobuf", "mcap", "mcap_protobuf")
_TIMINGS_SCHEMA = {
    "type": "object",
    "title": "meshslam.Timings",
    "description": "what a frame took, by stage, milliseconds",
    "additionalProperties": {"type": "number"},
}


def can_write_mcap() -> bool:
    """Whether the packages of the extra `foxglove` are installed."""
    return all(importlib.util.find_spec(name) is not None for name in _PACKAGES)


class McapLog:
    """The run as Foxglove's messages: docs/viewers.md lists the topics; a `RunLog` to be used by one thread.

    Message times are the frames' own. The file is written chunk by chunk as the run computes; a killed process leaves
    all chunks but the last. The file is opened by `begin`: ConfigError where it cannot be written.
    """

    def __init__(self, file: Path, *, colouring: Colouring = "id") -> None:
        self.colouring, self._path = colouring, file
        self._file: BinaryIO | None = None
        self._writer: Any = None
        self._channels: dict[str, int] = {}
        self._camera: Camera | None = None
        self._first_s: float | None = None
        self._last_s = 0.0
        self._offset_s = 0.0
        self._live_is_placed = False
        self._known = KnownObjects()
        self._waiting: Sequence[MapObject] = ()  # objects that were told before the first frame
        self._result: Map | None = None
        self._with_image: set[int] = set()  # frames

    def begin(self, title: str, camera: Camera) -> None:
        """As for `RunLog`."""
        from mcap.writer import Writer

        try:
            self._file = self._path.open("wb")
        except OSError as error:
            raise ConfigError(f"{self._path}: cannot be written: {error.strerror}") from None
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES)
        self._writer.start(profile="", library="meshslam")
        self._camera = camera
        self._writer.add_metadata("meshslam", {"recording": title})

    def frame(
        self,
        number: int,
        time_s: float,
        world_from_camera: Pose | None = None,
        covariance: Floats | None = None,
        image: LoggedImage | None = None,
        detections: Sequence[Detection] = (),
        objects: Sequence[MapObject] | None = None,
        timings_ms: Mapping[str, float] | None = None,
    ) -> None:
        """As for `RunLog`."""
        self._take_time(time_s)
        if self._waiting and objects is None:
            objects, self._waiting = self._waiting, ()
        if objects is not None:
            self.objects(objects)
        if world_from_camera is not None:
            self._put_pose(world_from_camera, covariance)
        if image is not None and number not in self._with_image:
            self._with_image.add(number)
            self._put_image(image() if callable(image) else image)
        self._put_annotations(detections, world_from_camera)
        if timings_ms:
            self._put_timings(timings_ms)

    def objects(self, objects: Sequence[MapObject]) -> None:
        """As for `RunLog`."""
        from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
        from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

        if self._first_s is None:  # no frame yet: there is no time to put it at
            self._waiting = objects
            return
        update, now = SceneUpdate(), self._nanoseconds(self._last_s)
        for thing, _ in self._known.changed(objects):
            update.entities.append(self._entity(thing, LIVE, now))
        for thing in self._known.gone():
            deletion = SceneEntityDeletion(type=SceneEntityDeletion.MATCHING_ID, id=_name(thing))
            _stamp(deletion.timestamp, now)
            update.deletions.append(deletion)
        if update.entities or update.deletions:
            self._place_live(Pose.identity())
            self._put("/live/objects", update, now)

    def result(
        self,
        scene: Map,
        frame_ids: Sequence[int],
        times_s: Floats,
        world_from_camera: Sequence[Pose],
        covariances: Floats | None = None,
        world_from_live: Pose | None = None,
    ) -> None:
        """As for `RunLog`."""
        from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
        from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

        self._result = scene
        if not len(times_s):
            return
        self._take_time(float(times_s[0]))
        now = self._nanoseconds(self._first_s or 0.0)  # so that it shows at all times
        update = SceneUpdate(entities=[self._entity(thing, WORLD, now) for thing in scene.objects])
        update.entities.append(_path_entity(world_from_camera, covariances, WORLD, now))
        self._put("/result/objects", update, now)
        if scene.objects:
            self._put("/result/points", self._points(scene, now), now)
        path = PosesInFrame(frame_id=WORLD, poses=[_pose(pose) for pose in world_from_camera])
        _stamp(path.timestamp, now)
        self._put("/result/path", path, now)
        if world_from_live is not None:
            self._live_is_placed = False
            self._place_live(world_from_live)

    def close(self) -> None:
        """As for `RunLog`: the file then has its index."""
        file, self._file = self._file, None
        if file is not None:
            with file:
                self._writer.finish()

    def _take_time(self, time_s: float) -> None:
        """Times of messages are not negative: where the recording begins below 0, it begins at 0 in the file."""
        if self._first_s is None:
            self._first_s, self._offset_s = time_s, max(0.0, -time_s)
        self._last_s = time_s

    def _nanoseconds(self, time_s: float) -> int:
        return max(0, round((time_s + self._offset_s) * NANOSECONDS))

    def _points(self, scene: Map, now: int) -> Any:  # noqa: ANN401 # a protobuf message
        """The vertices of all meshes as points: for viewers that draw no meshes."""
        from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
        from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

        places = np.concatenate([thing.vertices_in_world for thing in scene.objects])
        colours = np.concatenate([vertex_colours(thing, self.colouring) for thing in scene.objects])
        packed = np.zeros(len(places), dtype=[("position", "<f4", 3), ("colour", "u1", 4)])
        packed["position"], packed["colour"][:, :3], packed["colour"][:, 3] = places, colours, 255
        kinds = [("x", 0), ("y", 4), ("z", 8)], [("red", 12), ("green", 13), ("blue", 14), ("alpha", 15)]
        fields = [PackedElementField(name=n, offset=at, type=PackedElementField.FLOAT32) for n, at in kinds[0]]
        fields += [PackedElementField(name=n, offset=at, type=PackedElementField.UINT8) for n, at in kinds[1]]
        cloud = PointCloud(
            frame_id=WORLD,
            pose=_pose(Pose.identity()),
            point_stride=packed.itemsize,
            fields=fields,
            data=packed.tobytes(),
        )
        _stamp(cloud.timestamp, now)
        return cloud

    def _place_live(self, world_from_live: Pose) -> None:
        """Say where the world is that was computed in, from the first frame on."""
        if not self._live_is_placed:
            self._live_is_placed = True
            self._put_transform(LIVE, world_from_live, self._nanoseconds(self._first_s or 0.0))

    def _put_transform(self, child: str, world_from_child: Pose, now: int) -> None:
        from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform

        pose = _pose(world_from_child)
        transform = FrameTransform(
            parent_frame_id=WORLD, child_frame_id=child, translation=pose.position, rotation=pose.orientation
        )
        _stamp(transform.timestamp, now)
        self._put("/tf", transform, now)

    def _put_pose(self, world_from_camera: Pose, covariance: Floats | None) -> None:
        from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
        from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

        now = self._nanoseconds(self._last_s)
        self._put_transform(CAMERA, world_from_camera, now)
        placed = PoseInFrame(frame_id=WORLD, pose=_pose(world_from_camera))
        _stamp(placed.timestamp, now)
        self._put("/camera/pose", placed, now)
        if covariance is not None and self._result is None:
            entity = _path_entity([world_from_camera], covariance[None], LIVE, now)
            self._place_live(Pose.identity())
            self._put("/live/covariance", SceneUpdate(entities=[entity]), now)

    def _put_image(self, image: Bytes) -> None:
        import simplejpeg
        from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
        from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

        assert self._camera is not None
        camera, now = self._camera, self._nanoseconds(self._last_s)
        K = camera.matrix
        calibration = CameraCalibration(
            frame_id=CAMERA,
            width=camera.width,
            height=camera.height,
            distortion_model="plumb_bob",
            D=[0.0] * 5,
            K=K.ravel().tolist(),
            R=np.eye(3).ravel().tolist(),
            P=np.column_stack([K, np.zeros(3)]).ravel().tolist(),
        )
        _stamp(calibration.timestamp, now)
        self._put("/camera/calibration", calibration, now)
        data = simplejpeg.encode_jpeg(np.ascontiguousarray(image), JPEG_QUALITY, "BGR")
        compressed = CompressedImage(frame_id=CAMERA, data=data, format="jpeg")
        _stamp(compressed.timestamp, now)
        self._put("/camera/image", compressed, now)

    def _put_annotations(self, detections: Sequence[Detection], world_from_camera: Pose | None) -> None:
        """Masks filled in the colours of their tracks, and the meshes as the camera sees them."""
        from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations

        assert self._camera is not None
        now = self._nanoseconds(self._last_s)
        drawn = ImageAnnotations()
        _stamp(drawn.timestamp, now)
        for detection in detections:
            colour = detection_colour(detection)
            for border in mask_contours((detection.mask() > 0).astype(np.uint8)):
                drawn.points.append(_loop(border, colour, now, MASK_OPACITY))
        if world_from_camera is not None:
            things = self._known.current if self._result is None else self._result.objects
            for number, borders in mesh_outlines(self._camera, world_from_camera, things).items():
                drawn.points.extend(_loop(border, object_colour(number), now, 0.0) for border in borders)
        self._put("/camera/annotations", drawn, now)

    def _put_timings(self, timings_ms: Mapping[str, float]) -> None:
        topic, now = "/timings", self._nanoseconds(self._last_s)
        if topic not in self._channels:
            schema = self._writer.register_schema(
                "meshslam.Timings", "jsonschema", json.dumps(_TIMINGS_SCHEMA).encode()
            )
            self._channels[topic] = self._writer.register_channel(topic, "json", schema)
        self._writer.add_message(self._channels[topic], now, json.dumps(dict(timings_ms)).encode(), now)

    def _put(self, topic: str, message: Any, now: int) -> None:  # noqa: ANN401 # a protobuf message
        from mcap_protobuf.schema import register_schema

        if topic not in self._channels:
            schema = register_schema(self._writer, type(message))
            self._channels[topic] = self._writer.register_channel(topic, "protobuf", schema)
        self._writer.add_message(self._channels[topic], now, message.SerializeToString(), now)

    def _entity(self, thing: MapObject, frame: str, now: int) -> Any:  # noqa: ANN401 # a protobuf message
        """An object as a list of triangles in its own pose."""
        from foxglove_schemas_protobuf.Point3_pb2 import Point3
        from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
        from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive

        colours = vertex_colours(thing, self.colouring)
        triangles = TriangleListPrimitive(
            pose=_pose(thing.world_from_object),
            points=[Point3(x=x, y=y, z=z) for x, y, z in thing.vertices.tolist()],
            colors=[_colour(rgb) for rgb in colours],
            indices=thing.faces.ravel().tolist(),
        )
        entity = SceneEntity(frame_id=frame, id=_name(thing), triangles=[triangles])
        _stamp(entity.timestamp, now)
        return entity


def _path_entity(poses: Sequence[Pose], covariances: Floats | None, frame: str, now: int) -> Any:  # noqa: ANN401
    """The path as a line, and the ellipsoids of the cameras' positions."""
    from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
    from foxglove_schemas_protobuf.Point3_pb2 import Point3
    from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
    from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
    from foxglove_schemas_protobuf.Vector3_pb2 import Vector3

    entity = SceneEntity(frame_id=frame, id="path")
    _stamp(entity.timestamp, now)
    colour = _colour(np.array(PATH_RGB))
    if len(poses) > 1:
        points = [Point3(x=x, y=y, z=z) for x, y, z in (pose.translation.tolist() for pose in poses)]
        entity.lines.append(
            LinePrimitive(
                type=LinePrimitive.LINE_STRIP,
                pose=_pose(Pose.identity()),
                thickness=PATH_WIDTH_M,
                points=points,
                color=colour,
            )
        )
    if covariances is not None and len(poses):
        found = position_ellipsoids(poses, covariances)
        faint = _colour(np.array(PATH_RGB), 0.4)
        rows = zip(found.centres, found.half_sizes_m.tolist(), found.quaternions_xyzw, strict=True)
        for centre, (x, y, z), quaternion in rows:
            pose = _pose(Pose.from_quaternion(quaternion, centre, order="xyzw"))
            entity.spheres.append(SpherePrimitive(pose=pose, size=Vector3(x=2 * x, y=2 * y, z=2 * z), color=faint))
    return entity


def _loop(border: Floats, rgb: Bytes, now: int, filled: float) -> Any:  # noqa: ANN401 # a protobuf message
    """A closed line in the image; Foxglove's pixels have their centres at halves."""
    from foxglove_schemas_protobuf.Point2_pb2 import Point2
    from foxglove_schemas_protobuf.PointsAnnotation_pb2 import PointsAnnotation

    points = [Point2(x=x + 0.5, y=y + 0.5) for x, y in border.tolist()]
    loop = PointsAnnotation(
        type=PointsAnnotation.LINE_LOOP, points=points, outline_color=_colour(rgb), thickness=OUTLINE_PX
    )
    if filled:
        loop.fill_color.CopyFrom(_colour(rgb, filled))
    _stamp(loop.timestamp, now)
    return loop


def _pose(pose: Pose) -> Any:  # noqa: ANN401 # a protobuf message
    from foxglove_schemas_protobuf.Pose_pb2 import Pose as PoseMessage
    from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
    from foxglove_schemas_protobuf.Vector3_pb2 import Vector3

    (x, y, z), (qx, qy, qz, qw) = pose.translation.tolist(), pose.to_quaternion(order="xyzw").tolist()
    return PoseMessage(position=Vector3(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))


def _colour(rgb: Bytes, opacity: float = 1.0) -> Any:  # noqa: ANN401 # a protobuf message
    from foxglove_schemas_protobuf.Color_pb2 import Color

    r, g, b = (float(value) / 255 for value in rgb)
    return Color(r=r, g=g, b=b, a=opacity)


def _stamp(timestamp: Any, now: int) -> None:  # noqa: ANN401 # a protobuf message
    timestamp.seconds, timestamp.nanos = divmod(now, NANOSECONDS)


def _name(thing: MapObject) -> str:
    return f"{thing.category}_{thing.id}"
