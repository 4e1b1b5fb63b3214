"""The run as a recording for the Rerun viewer; needs the extra `rerun`."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np

from meshslam.maps import object_colour
from meshslam.viewing.context import ReportContext


def can_record() -> bool:
    """Whether the Rerun SDK is installed."""
    return importlib.util.find_spec("rerun") is not None


def write_recording(context: ReportContext, path: Path) -> None:
    """Write path, camera and meshes to `path` (.rrd): one frame a step of the timeline `frame`."""
    import rerun as rr  # slow to import, and an extra

    stream = rr.RecordingStream("meshslam", recording_id=context.title)
    stream.save(str(path))
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for thing in context.map.objects:
        vertices = thing.world_from_object.transform(thing.vertices)
        mesh = rr.Mesh3D(
            vertex_positions=vertices,
            triangle_indices=thing.faces,
            vertex_colors=np.tile(object_colour(thing.id), (len(vertices), 1)),
        )
        stream.log(f"world/{thing.category}_{thing.id}", mesh, static=True)
    centres = np.array([pose.translation for pose in context.world_from_camera])
    stream.log("world/path", rr.LineStrips3D([centres]), static=True)
    camera = context.camera
    for index, (frame, pose) in enumerate(zip(context.frame_ids, context.world_from_camera, strict=True)):
        stream.set_time("frame", sequence=frame)
        stream.log("world/camera", rr.Transform3D(translation=pose.translation, mat3x3=pose.rotation))
        lens = rr.Pinhole(image_from_camera=camera.matrix, width=camera.width, height=camera.height)
        stream.log("world/camera/image", lens)
        if context.read_image is not None:
            picture = rr.Image(context.read_image(index), color_model="BGR").compress(jpeg_quality=80)
            stream.log("world/camera/image", picture)
    stream.flush()
    stream.disconnect()
