"""Meshes over an image, drawn on every sample of it: the slow twin of `viewing.mesh_layer`."""

import cv2
import numpy as np

from meshslam.geometry import render
from meshslam.viewing.mesh_layer import EDGE, EDGE_PX, FAINT_FILL, FILL, SAMPLES, scaled_camera


def mesh_layer(camera, world_from_camera, shapes, faint=()):
    """The picture (h, w, 4) BGR and opacity, and what is visible of each shape, by number."""
    fine, camera_from_world = scaled_camera(camera, SAMPLES), world_from_camera.inverse()
    drawn = render(fine, [(camera_from_world @ s.world_from_object, s.vertices, s.faces) for s in shapes])
    index, samples, edge = drawn.object_index, np.zeros((fine.height, fine.width, 4), np.float32), _edges(drawn)
    boxes = {}
    for number, shape in enumerate(shapes):
        inside = index == number
        lit = _lit(shape, world_from_camera)[drawn.face_index[inside]].astype(np.float32)
        opacity = np.float32(FAINT_FILL if shape.id in faint else FILL)
        samples[inside] = np.column_stack([lit * opacity, np.full(len(lit), opacity)])
        outline = shape.colour_bgr.astype(np.float32) * np.float32(EDGE)
        samples[inside & edge] = [*outline, np.float32(EDGE)]
        if inside.any():
            rows, columns = np.nonzero(inside)
            ends = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
            boxes[shape.id] = tuple(ends / SAMPLES - 0.5)
    small = cv2.resize(samples, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    colours = small[..., :3] / np.maximum(small[..., 3:], 1e-6)
    return np.round(np.concatenate([colours, 255 * small[..., 3:]], axis=-1)).astype(np.uint8), boxes


def _lit(shape, world_from_camera):
    corners = shape.world_from_object.transform(shape.vertices)[shape.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    light = np.array([0.0, 0.0, 0.75]) - 0.65 * world_from_camera.rotation[:, 2]
    shade = np.clip(normals @ (light / np.linalg.norm(light)), 0, 1)[:, None]
    return np.clip(shape.colour_bgr * (0.35 + 0.75 * shade) + 60 * shade**4, 0, 255)


def _edges(drawn):
    """Samples near another object's, or near none, that are nearer to the camera."""
    index, near = drawn.object_index, drawn.inverse_depth
    found = np.zeros(index.shape, bool)
    for axis in (0, 1):
        for step in range(1, round(EDGE_PX * SAMPLES) + 1):
            for sign in (-1, 1):
                other, nearness = (np.roll(a, sign * step, axis) for a in (index, near))
                differs = (index != other) & (near > nearness)
                ends = np.arange(index.shape[axis]) - sign * step
                inside = (ends >= 0) & (ends < index.shape[axis])
                found |= differs & (inside[:, None] if axis == 0 else inside)
    return found
