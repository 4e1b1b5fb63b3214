"""One object of a map."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from meshslam.errors import MapError
from meshslam.geometry import Bools, Floats, Ints, Pose

CENTRE_TOLERANCE_M = 1e-6


@dataclass(frozen=True, eq=False)
class MapObject:
    """An instance with its pose and its own mesh.

    The object frame is x forward, y left, z up, its origin at the centre of the mesh's bounding box (`recentred` sees
    to that). `pose_covariance` is that of a right perturbation of `world_from_object`: (translation, rotation), m, rad.
    """

    id: int
    category: str
    world_from_object: Pose
    vertices: Floats  # (V, 3), in object, metres
    faces: Ints  # (F, 3)
    views: int = 0
    first_frame: int | None = None
    last_frame: int | None = None
    mask_iou: float | None = None
    keypoints: MappingProxyType[str, Floats] | dict[str, Floats] = field(default_factory=dict)  # (3,), in object
    pose_covariance: Floats | None = None  # (6, 6)
    vertex_sigma_m: Floats | None = None  # (V,)
    vertex_observed: Bools | None = None  # (V,)

    def __post_init__(self) -> None:
        problem = _problem(self)
        if problem:
            raise MapError(f"object {self.id}: {problem}")

    @property
    def dimensions(self) -> Floats:
        """Length, width, height (3,) of the mesh's bounding box, metres."""
        size: Floats = np.ptp(self.vertices, axis=0)
        return size

    @property
    def covariance(self) -> Floats | None:
        """Covariance (6, 6) of the pose: `pose_covariance`."""
        return self.pose_covariance

    @property
    def vertices_in_world(self) -> Floats:
        """The mesh's vertices (V, 3), metres."""
        return self.world_from_object.transform(self.vertices)

    def recentred(self) -> MapObject:
        """Return the same object with the origin of its frame at the centre of its bounding box."""
        centre = (self.vertices.max(axis=0) + self.vertices.min(axis=0)) / 2
        if np.abs(centre).max() <= CENTRE_TOLERANCE_M:
            return self
        covariance = None if self.pose_covariance is None else _moved_covariance(self.pose_covariance, centre)
        return replace(
            self,
            world_from_object=self.world_from_object @ Pose(np.eye(3), centre),
            vertices=self.vertices - centre,
            keypoints={name: point - centre for name, point in self.keypoints.items()},
            pose_covariance=covariance,
        )


def _moved_covariance(covariance: Floats, origin: Floats) -> Floats:
    """Covariance of a right perturbation about another origin (3,) of the same frame: Exp(d) T = T Exp(Ad(T⁻¹) d)."""
    adjoint = Pose(np.eye(3), origin).inverse().adjoint()
    moved: Floats = adjoint @ covariance @ adjoint.T
    return moved


def _problem(thing: MapObject) -> str:
    """Say what is wrong with an object's fields, empty if nothing."""
    count = len(thing.vertices)
    arrays = {
        "vertices": (thing.vertices, (count, 3)),
        "faces": (thing.faces, (len(thing.faces), 3)),
        "world_from_object": (thing.world_from_object.matrix, (4, 4)),
        "pose_covariance": (thing.pose_covariance, (6, 6)),
        "vertex_sigma_m": (thing.vertex_sigma_m, (count,)),
        "vertex_observed": (thing.vertex_observed, (count,)),
        **{f"keypoints {name}": (point, (3,)) for name, point in thing.keypoints.items()},
    }
    for name, (array, shape) in arrays.items():
        if array is not None and np.shape(array) != shape:
            return f"{name} has shape {np.shape(array)}, expected {shape}"
        if array is not None and not np.isfinite(array).all():
            return f"{name} holds NaN or infinity"
    if not count or not len(thing.faces) or thing.faces.min() < 0 or thing.faces.max() >= count:
        return "the mesh has no faces, or a face whose corner is no vertex"
    if thing.mask_iou is not None and not 0 <= thing.mask_iou <= 1:
        return f"mask_iou is {thing.mask_iou}, expected 0 to 1"
    return ""
