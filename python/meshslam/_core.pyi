"""The native module; `meshslam.geometry` is its public face."""

from collections.abc import Sequence
from typing import Protocol, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "BlockSystem",
    "LinearFactor",
    "MaskLoss",
    "ObjectState",
    "ParkedMap",
    "Problem",
    "RoadTexture",
    "Solution",
    "Template",
    "TrackedPoints",
    "Variables",
    "View",
    "broadcast_shape",
    "cotangent_weights",
    "coverage",
    "exp_so3",
    "kato_pixel_gradient",
    "keypoint_losses",
    "linear_cost",
    "log_so3",
    "mask_gradients",
    "mask_iou_losses",
    "outline",
    "rasterize",
    "right_jacobian",
    "right_jacobian_inverse",
    "silhouette_gradients",
    "silhouettes",
    "triangulate",
    "voxel_iou",
    "weighted_sums",
]

_Floats = NDArray[np.float64]
_Ints = NDArray[np.int64]
_Bools = NDArray[np.bool_]
_Rect = tuple[int, int, int, int]  # x0, y0, width, height

# read by the names of their attributes

class _Camera(Protocol):
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def fx(self) -> float: ...
    @property
    def fy(self) -> float: ...
    @property
    def cx(self) -> float: ...
    @property
    def cy(self) -> float: ...
    @property
    def skew(self) -> float: ...

class _NoiseModel(Protocol):
    @property
    def border_sigma_px(self) -> float: ...
    @property
    def border_correlation_px(self) -> float: ...
    @property
    def border_kernel(self) -> float: ...
    @property
    def border_cap_px(self) -> float: ...
    @property
    def outline_step_px(self) -> float: ...
    @property
    def keypoint_position_sigma_m(self) -> float: ...
    @property
    def keypoint_kernel(self) -> float: ...
    @property
    def free_form_sigma_m(self) -> float: ...
    @property
    def smoothness_sigma_m(self) -> float: ...

class _GroundPlane(Protocol):
    @property
    def normal(self) -> _Floats: ...
    @property
    def offset_m(self) -> float: ...
    @property
    def height_sigma_m(self) -> float: ...
    @property
    def tilt_sigma_rad(self) -> float: ...

def exp_so3(theta: _Floats) -> _Floats: ...
def log_so3(rotations: _Floats) -> _Floats: ...
def right_jacobian(theta: _Floats) -> _Floats: ...
def right_jacobian_inverse(theta: _Floats) -> _Floats: ...
def cotangent_weights(vertices: _Floats, face_array: _Ints) -> tuple[_Ints, _Floats]: ...
def voxel_iou(vertices_a: _Floats, faces_a: _Ints, vertices_b: _Floats, faces_b: _Ints, step_m: float) -> float: ...
def triangulate(
    camera: _Camera, camera_from_world: Sequence[_Floats], observed: _Floats, sigma_px: _Floats, cauchy: float
) -> tuple[_Floats, _Floats] | None: ...
def rasterize(
    camera: _Camera, meshes: Sequence[tuple[_Floats, _Ints]], rect_values: _Rect
) -> tuple[NDArray[np.int32], NDArray[np.int32], _Floats]: ...
def coverage(
    camera: _Camera, points_in_camera: _Floats, face_array: _Ints, rect_values: _Rect, samples: int
) -> _Floats: ...
def outline(
    camera: _Camera, points_in_camera: _Floats, face_array: _Ints, rect_values: _Rect, step_px: float
) -> _Floats: ...

_Gradient = tuple[float, float, float, _Floats, _Floats, _Floats]

def kato_pixel_gradient(
    vertex_pixels: _Floats, face_array: _Ints, face_index: NDArray[np.int32], slope: _Floats
) -> _Floats: ...
def mask_gradients(
    losses: Sequence[MaskLoss], camera_from_object: Sequence[tuple[_Floats, _Floats]], vertices: _Floats, threads: int
) -> list[_Gradient]: ...

_Reals = NDArray[np.float64] | NDArray[np.float32]
_Inputs = tuple[_Reals, _Ints, _Reals, _Floats]  # vertices, faces, camera_from_object, intrinsics
_Losses = tuple[_Reals, _Reals | None, _Reals | None]

def mask_iou_losses(
    inputs: _Inputs,
    masks: _Reals | NDArray[np.uint8],
    method: str,
    with_gradient: bool,
    threads: int,
) -> _Losses: ...
def broadcast_shape(shapes: Sequence[Sequence[int]]) -> list[int]: ...
def silhouettes(
    inputs: _Inputs,
    pictures: _Reals,
    threads: int,
) -> None: ...
def silhouette_gradients(
    inputs: _Inputs,
    slopes: _Reals,
    threads: int,
) -> list[_Reals]: ...
def keypoint_losses(
    inputs: _Inputs,
    association: _Floats,
    observed: _Reals,
    visible: _Bools,
    threads: int,
) -> _Losses: ...
def weighted_sums(values: _Reals, weights: _Reals | None, leading: Sequence[int]) -> _Reals: ...

@final
class MaskLoss:
    def __new__(
        cls,
        camera: _Camera,
        vertex_count: int,
        face_array: _Ints,
        mask: NDArray[np.uint8],
        origin: tuple[int, int],
    ) -> MaskLoss: ...
    def gradient(self, rotation: _Floats, translation: _Floats, vertices: _Floats, kato: bool) -> _Gradient: ...
    def draw(self, rotation: _Floats, translation: _Floats, vertices: _Floats) -> NDArray[np.uint8]: ...
    def time(self, rotation: _Floats, translation: _Floats, vertices: _Floats, runs: int) -> list[float]: ...

@final
class ParkedMap:
    def __new__(cls, objects: _Floats) -> ParkedMap: ...
    def candidates(
        self,
        seen: _Floats,
        ends: Sequence[tuple[int, int]],
        pairs: Sequence[NDArray[np.int32]],
        rules: tuple[float, float, float, float, float, float, float, float],
        keep: int,
    ) -> _Floats: ...

@final
class RoadTexture:
    def __new__(
        cls,
        camera: _Camera,
        images: tuple[NDArray[np.uint8], NDArray[np.uint8]],
        free: NDArray[np.uint8],
        first_from_second: _Floats,
        up: _Floats,
        height_m: float,
        depths_m: tuple[float, float],
        aside_m: float,
        step_px: int,
    ) -> RoadTexture: ...
    def __len__(self) -> int: ...
    def correlations(self, lengths_m: _Floats) -> _Floats: ...

@final
class TrackedPoints:
    def __new__(cls, camera: _Camera, tracks: Sequence[_Floats], sigma_px: float, kernel: float) -> TrackedPoints: ...
    def tracks(self) -> list[_Floats]: ...
    def cost(self, world_from_camera: _Floats) -> float: ...
    def normal_equations(self, world_from_camera: _Floats) -> tuple[_Floats, _Floats, float]: ...
    def points(self, world_from_camera: _Floats) -> tuple[_Floats, list[bool]]: ...

@final
class View:
    def __new__(
        cls,
        camera: _Camera,
        world_from_camera: _Floats,
        time_s: float,
        origin: tuple[int, int],
        distance_px: NDArray[np.float32],
        cut: NDArray[np.uint8],
        hidden: NDArray[np.uint8],
        border: _Floats,
        border_length: _Floats,
        border_own: _Bools,
        keypoint_index: _Ints,
        keypoint_pixels: _Floats,
        keypoint_sigma_px: _Floats,
        keypoint_count: int,
    ) -> View: ...
    @property
    def origin(self) -> tuple[int, int]: ...
    @property
    def surface_sigma_px(self) -> float: ...
    def pictures(self) -> tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.uint8]]: ...
    def border(self) -> _Floats: ...
    def keypoints(self) -> _Floats: ...
    def with_surface_sigma(self, sigma_px: float) -> View: ...
    def with_keypoint_sigma(self, sigma_px: float) -> View: ...

_Names = NDArray[np.uint64]

@final
class Variables:
    def __new__(
        cls,
        poses: tuple[_Names, _Floats],
        rotations: tuple[_Names, _Floats],
        vectors: Sequence[tuple[_Names, _Floats]],
    ) -> Variables: ...

@final
class LinearFactor:
    def __new__(cls, names: _Names, at: Variables, rows: _Floats) -> LinearFactor: ...

def linear_cost(factors: Sequence[LinearFactor], variables: Variables) -> float: ...

@final
class BlockSystem:
    def __new__(cls, names: _Names, widths: _Ints, blocks: _Names) -> BlockSystem: ...
    def add_linear(self, factors: Sequence[LinearFactor], variables: Variables) -> None: ...
    def add_rows(self, names: _Names, rows: _Floats) -> None: ...
    def add_all_rows(self, names: _Names, rows: _Floats) -> None: ...
    def add_information(self, names: _Names, hessian: _Floats, gradient: _Floats) -> None: ...
    def solve(self, last: _Names) -> Solution: ...
    def covariances(self, groups: Sequence[_Names], last: _Names) -> list[_Floats]: ...

@final
class Solution:
    @property
    def step(self) -> _Floats: ...
    def covariance(self, names: _Names) -> _Floats | None: ...

@final
class ObjectState:
    def __new__(cls, *, world_from_object: _Floats, z: _Floats, d: _Floats, velocity: _Floats) -> ObjectState: ...

@final
class Problem:
    def __new__(
        cls,
        *,
        views: Sequence[View],
        ground: _GroundPlane | None,
        noise: _NoiseModel,
        modes: bool,
        free_form: bool,
        velocity: bool,
        state: ObjectState,
    ) -> Problem: ...

@final
class Template:
    def __new__(
        cls,
        vertices: _Floats,
        faces_array: _Ints,
        modes: _Floats,
        mirror: _Ints | None,
        keypoint_weights: _Floats,
        wheels: _Ints,
    ) -> Template: ...
    @property
    def free_form_dimension(self) -> int: ...
    def vertices(self, z: _Floats, d: _Floats) -> _Floats: ...
    def free_form_gradient(self, vertex_gradient: _Floats) -> _Floats: ...
    def refine(
        self,
        problem: Problem,
        max_iterations: int,
        least_decrease: float,
    ) -> tuple[_Floats, _Floats, _Floats, _Floats, float, str, list[tuple[float, float, float, int]]]: ...
    def time(
        self,
        problem: Problem,
        runs: int,
    ) -> list[float]: ...
    def uncertainty(
        self,
        problem: Problem,
        per_vertex: bool,
    ) -> tuple[_Floats, _Floats, _Bools]: ...
    def covariance(
        self,
        problem: Problem,
        blocks: Sequence[str],
    ) -> _Floats: ...
    def border_distances(
        self,
        views: Sequence[View],
        state: ObjectState,
        step_px: float,
    ) -> list[_Floats]: ...
    def square_root(
        self,
        view: View,
        noise: _NoiseModel,
        camera_from_object: _Floats,
        z: _Floats,
        d: _Floats,
        modes: bool,
    ) -> tuple[_Floats, float, float]: ...
    def square_roots(
        self,
        views: Sequence[View],
        noise: _NoiseModel,
        camera_from_object: _Floats,
        z: _Floats,
        modes: bool,
    ) -> tuple[_Floats, list[float], list[float]]: ...
    def mask_ious(self, views: Sequence[View], world_from_object: Sequence[_Floats], vertices: _Floats) -> _Floats: ...
