"""A run for the Rerun viewer: live, served, or kept as a recording (.rrd); needs the extra `rerun`."""

from __future__ import annotations

import importlib.util
import os
import socket
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from meshslam.errors import ConfigError
from meshslam.geometry import Bytes, Camera, Floats, Pose
from meshslam.maps import Map, MapObject, object_colour
from meshslam.perception import Detection
from meshslam.viewing.log_shapes import (
    KnownObjects,
    mesh_outlines,
    position_ellipsoids,
    vertex_colours,
)
from meshslam.viewing.overlay import UNMAPPED_RGB
from meshslam.viewing.run_log import Colouring, LoggedImage

WEB_PORT, GRPC_PORT = 9090, 9876  # Rerun's own; others are taken where these are in use
FLUSH_S = 20.0
JPEG_QUALITY = 80
MASK_OPACITY = 0.15  # viewers mix light, not values: it looks like 0.4
PIXEL_CENTRE = 0.5  # of the first pixel, for Rerun; ours is 0
BEHIND_M = 10.0  # of the start, from where the result is looked at
IMAGE_PLANE_M = 1.5  # distance of the image in the 3-D view
PATH_RGB, LIVE_PATH_RGB = (235, 110, 20), (60, 140, 235)
PATH_RADIUS_M = 0.05
UNTRACKED = 1  # class of masks that are on no track; tracks have the classes above
TRACKS = 1024  # that have a class of their own
LONGEST_DURATION_S = 1e8  # times above are those of a clock that began in 1970
CAMERA, IMAGE, LIVE = "world/camera", "world/camera/image", "world/live"


def can_record() -> bool:
    """Whether the Rerun SDK is installed."""
    return importlib.util.find_spec("rerun") is not None


def has_display() -> bool:
    """Whether a window can be opened."""
    return sys.platform != "linux" or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


class RerunLog:
    """The run as Rerun's entities: docs/viewers.md lists them; a `RunLog` to be used by one thread.

    `file` is written as the run computes, and holds what was told even if the process is killed. `view` opens the
    viewer, `serve` makes this process a server for viewers, `web_address` says where: ConfigError where these cannot
    be opened. The file is opened by `begin`, which raises ConfigError too.
    """

    def __init__(
        self,
        file: Path | None = None,
        *,
        view: bool = False,
        serve: bool = False,
        colouring: Colouring = "id",
        recording_id: str | None = None,
    ) -> None:
        import rerun as rr  # slow to import, and an extra

        self.web_address: str | None = None
        self.colouring = colouring
        self._stream: Any = rr.RecordingStream("meshslam", recording_id=recording_id)
        self._file, self._sinks = file, list[Any]()
        try:
            self._sinks += [_viewer(self._stream)] if view else []
            if serve:
                self._sinks.append(rr.GrpcServerSink("127.0.0.1", _free_port(GRPC_PORT)))
                self.web_address = _served_web(self._sinks[-1].uri)
        except (RuntimeError, OSError, ValueError) as error:
            raise ConfigError(f"the Rerun viewer cannot be opened: {' '.join(str(error).split())}") from None
        self._camera: Camera | None = None
        self._uses_clock: bool | None = None
        self._known = KnownObjects()
        self._waiting: Sequence[MapObject] = ()  # objects that were told before the first frame
        self._result: Map | None = None
        self._with_image: set[int] = set()  # frames
        self._placed: set[int] = set()  # frames whose pose is in the live path
        self._last_position: Floats | None = None

    def begin(self, title: str, camera: Camera) -> None:
        """As for `RunLog`."""
        import rerun as rr

        try:
            files = [] if self._file is None else [rr.FileSink(str(self._file))]
            self._stream.set_sinks(*files, *self._sinks)
        except (RuntimeError, OSError, ValueError) as error:
            raise ConfigError(f"{self._file}: cannot be written: {' '.join(str(error).split())}") from None
        self._camera = camera
        self._static(IMAGE, _classes())
        self._stream.send_recording_name(title)
        self._stream.send_blueprint(_blueprint())
        self._static("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        matrix = camera.matrix.copy()
        matrix[:2, 2] += PIXEL_CENTRE
        for path in (IMAGE, f"{LIVE}/camera"):
            lens = rr.Pinhole(
                image_from_camera=matrix,
                width=camera.width,
                height=camera.height,
                image_plane_distance=IMAGE_PLANE_M,
            )
            self._static(path, lens)

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
        import rerun as rr

        self._set_time(number, time_s)
        if self._waiting and objects is None:
            objects, self._waiting = self._waiting, ()
        if objects is not None:
            self.objects(objects)
        if world_from_camera is not None:
            self._stream.log(CAMERA, _transform(world_from_camera))
            self._extend_live_path(number, world_from_camera, covariance)
        if image is not None and number not in self._with_image:
            self._with_image.add(number)
            self._stream.log(IMAGE, _encoded(image() if callable(image) else image))
        self._log_masks(detections)
        if world_from_camera is not None:
            self._log_outlines(world_from_camera)
        for stage, milliseconds in (timings_ms or {}).items():
            self._stream.log(f"timings/{stage}", rr.Scalars(milliseconds))

    def objects(self, objects: Sequence[MapObject]) -> None:
        """As for `RunLog`."""
        import rerun as rr

        if self._uses_clock is None:  # no frame yet: without a time nothing would show
            self._waiting = objects
            return
        for thing, has_other_mesh in self._known.changed(objects):
            path = f"{LIVE}/objects/{_name(thing)}"
            self._stream.log(path, _transform(thing.world_from_object))
            if has_other_mesh:
                self._stream.log(path, self._mesh(thing, thing.vertices))
        for thing in self._known.gone():
            self._stream.log(f"{LIVE}/objects/{_name(thing)}", rr.Clear(recursive=True))

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
        import rerun as rr

        self._result = scene
        self._placed.update(frame_ids)  # the path of frames that were told nothing before is the result's alone
        if world_from_live is not None:
            self._static(LIVE, _transform(world_from_live))
        for thing in scene.objects:
            self._static(f"world/result/objects/{_name(thing)}", self._mesh(thing, thing.vertices_in_world))
        centres = np.array([pose.translation for pose in world_from_camera]).reshape(-1, 3)
        if len(centres) > 1:
            self._static("world/result/path", rr.LineStrips3D([centres], colors=[PATH_RGB], radii=PATH_RADIUS_M))
        if covariances is not None and len(centres):
            self._static("world/result/covariances", _ellipsoids(world_from_camera, covariances, PATH_RGB))
        self._stream.send_blueprint(_blueprint(_viewpoint(world_from_camera)))

    def close(self) -> None:
        """As for `RunLog`: what was told is then in the file, and with the viewer."""
        try:
            self._stream.flush(timeout_sec=FLUSH_S)  # a viewer that was closed never answers
        finally:
            self._stream.disconnect()

    def _set_time(self, number: int, time_s: float) -> None:
        if self._uses_clock is None:
            self._uses_clock = abs(time_s) > LONGEST_DURATION_S
        self._stream.set_time("frame", sequence=number)
        if self._uses_clock:
            self._stream.set_time("time", timestamp=np.datetime64(round(1e9 * time_s), "ns"))
        else:
            self._stream.set_time("time", duration=time_s)

    def _static(self, path: str, what: Any) -> None:  # noqa: ANN401 # an archetype of Rerun
        self._stream.log(path, what, static=True)

    def _mesh(self, thing: MapObject, vertices: Floats) -> Any:  # noqa: ANN401 # an archetype of Rerun
        import rerun as rr

        colours = vertex_colours(thing, self.colouring)
        return rr.Mesh3D(
            vertex_positions=vertices,
            triangle_indices=thing.faces,
            vertex_normals=_normals(vertices, thing.faces),
            vertex_colors=colours,
        )

    def _extend_live_path(self, number: int, pose: Pose, covariance: Floats | None) -> None:
        """One more piece of the live path, for a frame that had no pose before: views gather the pieces up to it."""
        import rerun as rr

        if number in self._placed:
            return
        self._placed.add(number)
        ends = [pose.translation if self._last_position is None else self._last_position, pose.translation]
        self._last_position = pose.translation
        self._stream.log(f"{LIVE}/camera", _transform(pose))
        self._stream.log(f"{LIVE}/path", rr.LineStrips3D([ends], colors=[LIVE_PATH_RGB], radii=PATH_RADIUS_M))
        if covariance is not None:
            self._stream.log(f"{LIVE}/covariance", _ellipsoids([pose], covariance[None], LIVE_PATH_RGB))

    def _log_masks(self, detections: Sequence[Detection]) -> None:
        import rerun as rr

        assert self._camera is not None
        classes = np.zeros((self._camera.height, self._camera.width), np.uint16)
        for detection in sorted(detections, key=lambda d: -d.bbox[2] * d.bbox[3]):  # small ones stay visible
            classes[detection.mask() > 0] = _class_of(detection)
        self._stream.log(f"{IMAGE}/masks", rr.SegmentationImage(classes, opacity=MASK_OPACITY))

    def _log_outlines(self, world_from_camera: Pose) -> None:
        """Meshes as the camera sees them: of the result, or of what is known by now."""
        import rerun as rr

        assert self._camera is not None
        things = self._known.current if self._result is None else self._result.objects
        outlines = mesh_outlines(self._camera, world_from_camera, things)
        rows = [(number, border) for number, borders in outlines.items() for border in borders]
        strips = [np.concatenate([border, border[:1]]) + PIXEL_CENTRE for _, border in rows]
        colours = [object_colour(number) for number, _ in rows]
        labels = [str(number) if i == 0 else "" for number, borders in outlines.items() for i in range(len(borders))]
        drawn = rr.LineStrips2D(strips, colors=colours, labels=labels, radii=rr.Radius.ui_points(1.0))
        self._stream.log(f"{IMAGE}/meshes", drawn)


def _transform(pose: Pose) -> Any:  # noqa: ANN401 # an archetype of Rerun
    import rerun as rr

    return rr.Transform3D(translation=pose.translation, mat3x3=pose.rotation)


def _name(thing: MapObject) -> str:
    return f"{thing.category}_{thing.id}"


def _class_of(detection: Detection) -> int:
    """The class of a mask: its track's; tracks beyond `TRACKS` share the classes of others."""
    return UNTRACKED if detection.track_id is None else UNTRACKED + 1 + detection.track_id % TRACKS


def _classes() -> Any:  # noqa: ANN401 # an archetype of Rerun
    """Colours of masks, told once: the viewer does not follow a context that changes from frame to frame."""
    import rerun as rr

    tracks = [(UNTRACKED + 1 + track, f"track {track}", object_colour(track).tolist()) for track in range(TRACKS)]
    rows = [(0, "", (0, 0, 0, 0)), (UNTRACKED, "on no track", UNMAPPED_RGB), *tracks]
    return rr.AnnotationContext([rr.AnnotationInfo(number, label, colour) for number, label, colour in rows])


def _encoded(image: Bytes) -> Any:  # noqa: ANN401 # an archetype of Rerun
    import rerun as rr
    import simplejpeg

    data = simplejpeg.encode_jpeg(np.ascontiguousarray(image), JPEG_QUALITY, "BGR")
    return rr.EncodedImage(contents=data, media_type="image/jpeg")


def _normals(vertices: Floats, faces: Any) -> Floats:  # noqa: ANN401 # integers (F, 3)
    """Normals (V, 3), smooth: without them viewers draw every face flat."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    summed = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(summed, faces[:, corner], normals)
    found: Floats = summed / np.maximum(np.linalg.norm(summed, axis=1, keepdims=True), 1e-12)
    return found


def _ellipsoids(poses: Sequence[Pose], covariances: Floats, rgb: tuple[int, int, int]) -> Any:  # noqa: ANN401
    import rerun as rr

    found = position_ellipsoids(poses, covariances)
    return rr.Ellipsoids3D(
        centers=found.centres,
        half_sizes=found.half_sizes_m,
        quaternions=found.quaternions_xyzw,
        colors=[rgb],
        fill_mode="majorwireframe",
    )


def _viewer(stream: Any) -> Any:  # noqa: ANN401 # a sink for a stream of Rerun
    """A viewer's window: one that listens already, or a new one, by the program that came with the SDK."""
    import rerun as rr

    cli = importlib.util.find_spec("rerun_cli")
    program = None if cli is None or cli.origin is None else Path(cli.origin).with_name("rerun")
    given = {"executable_path": str(program)} if program is not None and program.is_file() else {}
    rr.spawn(port=GRPC_PORT, connect=False, hide_welcome_screen=True, recording=stream, **given)
    return rr.GrpcSink(f"rerun+http://127.0.0.1:{GRPC_PORT}/proxy")


def _served_web(uri: str) -> str:
    """Serve the viewer as a page; the address that opens it on the run."""
    import rerun as rr

    port, local = _free_port(WEB_PORT), uri.replace("0.0.0.0", "127.0.0.1")
    rr.serve_web_viewer(web_port=port, open_browser=False)
    return f"http://127.0.0.1:{port}/?url={quote(local, safe='')}"


def _free_port(wanted: int) -> int:
    """The wanted port, or another one if it is in use."""
    for port in (wanted, 0):
        with socket.socket() as probe:
            try:
                probe.bind(("0.0.0.0", port))
            except OSError:
                continue
            return int(probe.getsockname()[1])
    raise OSError(f"no port can be opened, {wanted} is in use")


def _viewpoint(world_from_camera: Sequence[Pose]) -> Any:  # noqa: ANN401 # a part of a blueprint of Rerun
    """From above and behind the start, along the path; None where there is no path."""
    import rerun.blueprint as rrb

    if not world_from_camera:
        return None
    start, ahead = world_from_camera[0].translation, world_from_camera[0].rotation[:, 2].copy()
    ahead[2] = 0.0
    ahead /= max(float(np.linalg.norm(ahead)), 1e-9)
    up = np.array([0.0, 0.0, 1.0])
    eye, target = start + BEHIND_M * (up - 1.5 * ahead), start + BEHIND_M * ahead
    return rrb.EyeControls3D(position=eye, look_target=target, eye_up=up)


def _blueprint(viewpoint: Any = None) -> Any:  # noqa: ANN401 # of and from parts of a blueprint of Rerun
    """The result and what was computed live as tabs, beside the camera and the times that frames took.

    With a viewpoint the result is shown from it; without one there is none yet, and the newest frame is followed.
    """
    import rerun.blueprint as rrb

    is_live = viewpoint is None
    always = rrb.TimeRangeBoundary.infinite()
    so_far = [
        rrb.VisibleTimeRange("frame", start=always, end=rrb.TimeRangeBoundary.cursor_relative(seq=0)),
        rrb.VisibleTimeRange("time", start=always, end=rrb.TimeRangeBoundary.cursor_relative(seconds=0.0)),
        rrb.VisibleTimeRange("log_time", start=always, end=rrb.TimeRangeBoundary.cursor_relative(seconds=0.0)),
    ]
    gathered = {name: rrb.VisibleTimeRanges(so_far) for name in (f"{LIVE}/path", f"{LIVE}/covariance")}
    result = rrb.Spatial3DView(
        origin="world", contents=[f"{CAMERA}/**", "world/result/**"], name="Result", eye_controls=viewpoint
    )
    live = rrb.Spatial3DView(origin="world", contents=[f"{LIVE}/**"], name="Live", overrides=gathered)
    tabs = rrb.Tabs(result, live, active_tab=1 if is_live else 0)
    beside = rrb.Vertical(
        rrb.Spatial2DView(origin=IMAGE, name="Camera"),
        rrb.TimeSeriesView(origin="timings", name="Milliseconds"),
        row_shares=[3, 1],
    )
    time = rrb.TimePanel(timeline="frame", play_state="following" if is_live else "paused")
    return rrb.Blueprint(rrb.Horizontal(tabs, beside), time, collapse_panels=True)
