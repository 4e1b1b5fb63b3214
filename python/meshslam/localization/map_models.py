"""Objects of a map, whatever their mesh's topology, ready to be compared with views."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from meshslam.errors import MapError
from meshslam.geometry import Camera, Floats, Ints, ObjectModel, Pose
from meshslam.maps import ConstellationIndex, Map, MapObject, TiledMap

NEAR_M = 0.3
_FEW = 1000
_KEPT_M = 20.0  # tiles are kept so much farther than they are needed, so that none is read again and again
_GRID_M = 0.15


@dataclass(frozen=True, eq=False)
class KnownObject:
    """One object: its mesh is fixed, its key points are carried along as vertices of no face."""

    id: int
    category: str
    world_from_object: Pose
    model: ObjectModel
    vertices: Floats  # (V, 3), in object
    faces: Ints  # (F, 3)
    keypoint_names: tuple[str, ...]
    keypoints: Floats  # (K, 3), in object
    pose_covariance: Floats | None  # (6, 6), right perturbation, (translation, rotation)
    corners: Floats  # (8, 3), of the mesh's bounding box
    hull: tuple[Floats, Ints]  # vertices and faces of its convex hull, coarse: for association

    def box(self, camera: Camera, world_from_camera: Pose) -> Floats | None:
        """Its box on the image (x0, y0, x1, y1), px, perhaps beyond it; None if it is not before the camera."""
        corners = (world_from_camera.inverse() @ self.world_from_object).transform(self.corners)
        if corners[:, 2].max() < NEAR_M:
            return None
        corners[:, 2] = np.maximum(corners[:, 2], NEAR_M)
        pixels = camera.project(corners)
        low, high = pixels.min(0), pixels.max(0)
        if high[0] < 0 or high[1] < 0 or low[0] > camera.width or low[1] > camera.height:
            return None
        return np.concatenate([low, high])


def box_corners(vertices: Floats) -> Floats:
    """Corners (8, 3) of the vertices' bounding box."""
    low, high = vertices.min(0), vertices.max(0)
    pick = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], bool)
    corners: Floats = np.where(pick, high, low)
    return corners


def coarse_hull(vertices: Floats) -> tuple[Floats, Ints]:
    """The convex hull of vertices rounded to a grid: some hundred faces, turned outwards; the box if it is flat."""
    from scipy.spatial import ConvexHull, QhullError  # slow to import

    rounded = np.unique(np.round(vertices / _GRID_M), axis=0) * _GRID_M
    try:
        hull = ConvexHull(rounded)
    except QhullError:
        corners = box_corners(vertices)
        return corners, np.array(
            [[0, 1, 2], [1, 3, 2], [4, 6, 5], [5, 6, 7], [0, 4, 1], [1, 4, 5], [2, 3, 6], [3, 7, 6]]
        )
    used, faces = np.unique(hull.simplices, return_inverse=True)
    return rounded[used], np.asarray(faces, np.int64).reshape(-1, 3)


def known_object(thing: MapObject) -> KnownObject:
    """Make a map's object ready."""
    names = tuple(sorted(thing.keypoints))
    points = np.array([thing.keypoints[n] for n in names]).reshape(-1, 3)
    vertices = np.concatenate([thing.vertices, points])
    weights = np.zeros((len(names), len(vertices)))
    weights[np.arange(len(names)), len(thing.vertices) + np.arange(len(names))] = 1.0
    no_modes, no_wheels = np.zeros((0, len(vertices), 3)), np.zeros(0, np.int64)
    model = ObjectModel(vertices, thing.faces, no_modes, None, weights, no_wheels)
    return KnownObject(
        thing.id,
        thing.category,
        thing.world_from_object,
        model,
        thing.vertices,
        thing.faces,
        names,
        points,
        thing.pose_covariance,
        box_corners(thing.vertices),
        coarse_hull(thing.vertices),
    )


@dataclass(eq=False)
class KnownMap:
    """The objects of a map that are ready: all of them, or, of a map in tiles, those around the camera."""

    scene: Map | TiledMap
    reach_m: float  # how far from the camera objects are looked for
    to_from_map: Pose = field(default_factory=Pose.identity)  # into the world that the camera is looked for in
    _tiles: OrderedDict[tuple[int, int], tuple[KnownObject, ...]] = field(default_factory=OrderedDict, repr=False)
    _index: ConstellationIndex | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if not len(self.scene):
            raise MapError("the map holds no objects: there is nothing to localize against")
        if isinstance(self.scene, Map):
            self._all: tuple[KnownObject, ...] = self._ready(self.scene.objects)

    def __len__(self) -> int:
        return len(self.scene)

    def around(self, position_m: Floats) -> tuple[KnownObject, ...]:
        """Objects that a camera at a position (3,) could see, by ascending id; tiles behind it are dropped."""
        if isinstance(self.scene, Map):
            return self._all
        place = self.to_from_map.inverse().transform(position_m[None])[0]
        keys = self.scene.keys_around(place[:2], self.reach_m)
        for key in keys:
            if key not in self._tiles:
                self._tiles[key] = self._ready(self.scene.tile(key))
        for key in self._tiles.keys() - set(self.scene.keys_around(place[:2], self.reach_m + _KEPT_M)):
            del self._tiles[key]
        return tuple(sorted((thing for key in keys for thing in self._tiles[key]), key=lambda thing: thing.id))

    @property
    def is_large(self) -> bool:
        """Whether a start is looked for by an index of the map, not among all its objects."""
        return isinstance(self.scene, TiledMap) and len(self.scene) > _FEW

    def all_of_few(self) -> tuple[KnownObject, ...]:
        """All objects of a map that is not large, to look for a start among them."""
        if isinstance(self.scene, Map):
            return self._all
        return tuple(sorted((o for t in self.scene.tiles() for o in self._ready(t)), key=lambda thing: thing.id))

    def constellations(self, radius_m: float) -> ConstellationIndex:
        """The index of a large map, as the map is now."""
        assert isinstance(self.scene, TiledMap)
        generation = self.scene.index.generation
        if self._index is None or (self._index.radius_m, self._index.generation) != (radius_m, generation):
            self._index = self.scene.constellations(radius_m)
        return self._index

    def _ready(self, things: Sequence[MapObject]) -> tuple[KnownObject, ...]:
        moved = (replace(t, world_from_object=self.to_from_map @ t.world_from_object) for t in things)
        return tuple(known_object(thing) for thing in moved)


def known_objects(scene: Map) -> tuple[KnownObject, ...]:
    """All objects of a map; MapError if it holds none."""
    return KnownMap(scene, np.inf).around(np.zeros(3))
