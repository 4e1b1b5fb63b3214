"""DEODR, a renderer with gradients of masks, and OpenCV's filling, timed on the cases of `render_cases`."""

from __future__ import annotations

import time

import cv2
import numpy as np
from deodr import differentiable_renderer_cython as deodr
from deodr.differentiable_renderer import Scene2DBase
from deodr.triangulated_mesh import TriMeshAdjacencies
from render_cases import CAMERA, Mesh

from meshslam.geometry import Pose

Box = tuple[int, int, int, int]


class Deodr:
    """DEODR's two core calls on a crop: one colour channel, no texture, sigma 1, its own silhouette edges."""

    def __init__(self, mesh: Mesh, pose: Pose, observed: np.ndarray, box: tuple[int, int, int, int]) -> None:
        x0, y0, x1, y1 = box
        points = pose.transform(mesh.vertices)
        ij = CAMERA.project(points) - [x0, y0]
        count, faces = len(points), mesh.faces.astype(np.uint32)
        edges = TriMeshAdjacencies(mesh.faces).edge_on_silhouette(ij)
        off = np.zeros(len(faces), bool)
        self.scene = Scene2DBase(
            faces=faces,
            faces_uv=faces,
            ij=ij,
            depths=points[:, 2].copy(),
            textured=off,
            uv=np.zeros((count, 2)),
            shade=np.zeros(count),
            colors=np.ones((count, 1)),
            shaded=off,
            edgeflags=edges,
            height=y1 - y0,
            width=x1 - x0,
            nb_colors=1,
            texture=np.zeros((0, 0)),
            background_color=np.zeros(1),
            uv_b=np.zeros((count, 2)),
            ij_b=np.zeros((count, 2)),
            shade_b=np.zeros(count),
            colors_b=np.zeros((count, 1)),
            texture_b=np.zeros((0, 0)),
        )
        self.image, self.depth = np.empty((y1 - y0, x1 - x0, 1)), np.empty((y1 - y0, x1 - x0))
        self.forward()
        seen = observed[y0:y1, x0:x1, None].astype(float)
        both = (seen * self.image).sum()
        union = (seen + self.image).sum() - both
        self.slope = np.where(seen > 0, -1 / union, both / union**2)

    def forward(self) -> None:
        """Draw."""
        deodr.renderSceneCpp(self.scene, 1.0, self.image, self.depth, False, None, None)

    def seconds(self) -> float:
        """Time of drawing and of going back; what is between and after them is left out."""
        start = time.perf_counter()
        self.forward()
        between = time.perf_counter()
        image = self.image.copy()  # going back overwrites it
        again = time.perf_counter()
        deodr.renderSceneBCpp(self.scene, 1.0, image, self.depth, self.slope, False, None, None, None)
        return between - start + time.perf_counter() - again


def opencv_seconds(mesh: Mesh, pose: Pose, box: tuple[int, int, int, int]) -> float:
    """Time of filling the front faces with OpenCV: forward only, the lower bound of what fills triangles."""
    corners = (CAMERA.project(pose.transform(mesh.vertices)) - box[:2])[mesh.faces]
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    front = np.round(corners[u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] < 0]).astype(np.int32)
    mask = np.zeros((box[3] - box[1], box[2] - box[0]), np.uint8)
    start = time.perf_counter()
    for triangle in front:
        cv2.fillConvexPoly(mask, triangle, 1)
    return time.perf_counter() - start
