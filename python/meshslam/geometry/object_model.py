"""The observation model of one object and its solver: V = mean + B z + S d, seen as masks and key points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from meshslam import _core
from meshslam.geometry.arrays import Bools, Floats, Ints, Singles
from meshslam.geometry.camera import Camera
from meshslam.geometry.native import floats, geometry_errors, ints
from meshslam.geometry.pose import Pose
from meshslam.settings import Settings, expert

View = _core.View

Block = Literal["pose", "modes", "free_form", "velocity"]  # of parameters


@dataclass(frozen=True)
class NoiseModel(Settings):
    """What is believed of the noise, and of shapes before they are seen."""

    border_sigma_px: float = expert(1.5, above=0)  # of an observed mask's border
    border_correlation_px: float = expert(25.0, above=0)  # length of border over which its error is one and the same
    border_kernel: float = expert(3.0, above=0)  # Huber's threshold, in sigmas
    surface_sigma_m: float = expert(0.025, low=0)  # of the true surface about the best mesh, the same for all masks
    border_cap_px: float = expert(60.0, above=0)  # residuals are cut here
    outline_step_px: float = expert(6.0, above=0)  # spacing of the outline's samples
    keypoint_position_sigma_m: float = expert(0.10, low=0)  # the category's key points against the instance's
    keypoint_kernel: float = expert(3.0, above=0)  # Geman and McClure's threshold, in sigmas
    free_form_sigma_m: float = expert(0.10, above=0)  # of a vertex's free displacement
    smoothness_sigma_m: float = expert(0.01, above=0)  # of its parting from its neighbours' average


@dataclass(frozen=True, eq=False)
class GroundPlane:
    """The road near an object: normal . x = offset_m, in the world; its height and tilt are known to their sigmas."""

    normal: Floats  # (3,), unit, up
    offset_m: float
    height_sigma_m: float
    tilt_sigma_rad: float

    def height_m(self, point_in_world: Floats) -> float:
        """Height of a point (3,), metres, over the plane."""
        return float(self.normal @ point_in_world) - self.offset_m


@dataclass(frozen=True, eq=False)
class ObjectState:
    """Where an object is and what it looks like."""

    world_from_object: Pose
    z: Floats  # (modes,), in standard deviations
    d: Floats  # free-form displacement, metres, one entry a degree of freedom of the symmetry basis
    velocity: Floats  # (3,) in the world, m/s; the pose holds at time 0


@dataclass(frozen=True)
class Iteration:
    """What one iteration of the solver did."""

    cost: float
    new_cost: float
    damping: float
    rejected: int


@dataclass(frozen=True, eq=False)
class Refined:
    """Where the solver ended, and how."""

    state: ObjectState
    cost: float
    stop: str  # converged, no descent, iteration limit
    iterations: tuple[Iteration, ...]


@dataclass(frozen=True, eq=False)
class SquareRoot:
    """A view's robust cost near a relative pose: half the squared norm of `root` @ (step, 1).

    The step is (translation, rotation, modes): a right perturbation of camera_from_object, and of z where asked for.
    """

    root: Floats  # (n + 1, n + 1), upper triangular
    cost: float
    observations: float  # how many independent ones there are


class ObjectModel:
    """A category's mesh, shape space, symmetry and key points, ready for the solver."""

    def __init__(
        self,
        vertices: Floats,
        faces: Ints,
        modes: Floats,
        mirror: Ints | None,
        keypoint_weights: Floats,
        wheel_vertices: Ints,
    ) -> None:
        """Take the mean (V, 3), faces (F, 3), modes (M, V, 3), mirror (V,), A transposed (K, V), wheels (n,).

        Vertices and modes in metres, modes at one standard deviation. GeometryError for a wrong shape, an index that
        names no vertex, or a value that is not finite.
        """
        self._made_of = (vertices, faces, modes, mirror, keypoint_weights, wheel_vertices)
        self.faces = ints(faces)
        self.keypoint_count = len(keypoint_weights)
        self.mode_count = len(modes)
        with geometry_errors():
            self._template = _core.Template(
                floats(vertices),
                self.faces,
                floats(modes),
                None if mirror is None else ints(mirror),
                floats(keypoint_weights),
                ints(wheel_vertices),
            )

    def __reduce__(self) -> tuple[type[ObjectModel], tuple[object, ...]]:
        """Pickles and copies are made anew of the same arrays."""
        return ObjectModel, self._made_of

    def state_at(self, world_from_object: Pose) -> ObjectState:
        """The mean shape at a pose."""
        d = np.zeros(self._template.free_form_dimension)
        return ObjectState(world_from_object, np.zeros(self.mode_count), d, np.zeros(3))

    def vertices(self, state: ObjectState) -> Floats:
        """Vertices (V, 3), metres, of a state's shape, in the object's frame."""
        return self._template.vertices(floats(state.z), floats(state.d))

    def free_form_gradient(self, vertex_gradient: Floats) -> Floats:
        """S^T g (D,): a gradient over vertices (V, 3) as one over the free-form displacement d.

        GeometryError for a wrong shape, or a value that is not finite.
        """
        with geometry_errors():
            return self._template.free_form_gradient(floats(vertex_gradient))

    def view(
        self,
        camera: Camera,
        world_from_camera: Pose,
        *,
        time_s: float = 0.0,
        origin: tuple[int, int],
        distance_px: Floats | Singles,
        cut: Bools,
        hidden: Bools,
        border: Floats,
        border_length_px: Floats,
        border_own: Bools,
        keypoint_index: Ints,
        keypoint_pixels: Floats,
        keypoint_sigma_px: Floats,
    ) -> View:
        """What one frame shows of the object at `time_s`, over a crop whose first pixel is `origin` (x, y).

        `distance_px` (h, w): signed distance to the observed border, negative inside. `cut`: the nearest border is not
        the object's own. `hidden`: an occluder covers the pixel. `border` (n, 2), with the length that each point
        stands for and whether it is the object's own. Key points (k,), (k, 2), (k,). Distances and sigmas are in
        pixels. GeometryError for a wrong shape, an index that no key point has, or a value that is not finite.
        """
        with geometry_errors():
            return _core.View(
                camera,
                floats(world_from_camera.matrix),
                time_s,
                origin,
                np.ascontiguousarray(distance_px, np.float32),
                np.ascontiguousarray(cut, np.uint8),
                np.ascontiguousarray(hidden, np.uint8),
                floats(border.reshape(-1, 2)),
                floats(border_length_px),
                np.ascontiguousarray(border_own, np.bool_),
                ints(keypoint_index),
                floats(keypoint_pixels.reshape(-1, 2)),
                floats(keypoint_sigma_px),
                self.keypoint_count,
            )

    def refine(
        self,
        views: Sequence[View],
        ground: GroundPlane | None,
        noise: NoiseModel,
        state: ObjectState,
        *,
        modes: bool,
        free_form: bool,
        velocity: bool = False,
        max_iterations: int = 30,
        least_decrease: float = 0.1,
    ) -> Refined:
        """Lower the cost over the pose, and over modes, free-form shape and velocity if asked, by Levenberg-Marquardt.

        A step is taken only if the true cost falls; the result is the best state seen, converged or not. It ends when a
        step lowers the cost, half a squared Mahalanobis distance, by less than `least_decrease`. GeometryError
        for a state that does not fit, or a noise model or ground whose values have no meaning.
        """
        with geometry_errors():
            pose, z, d, v, cost, stop, rows = self._template.refine(
                _problem(views, ground, noise, state, modes=modes, free_form=free_form, velocity=velocity),
                max_iterations,
                least_decrease,
            )
        iterations = tuple(Iteration(*row) for row in rows)
        return Refined(ObjectState(Pose.from_matrix(pose), z, d, v), cost, stop, iterations)

    def seconds(
        self,
        views: Sequence[View],
        ground: GroundPlane | None,
        noise: NoiseModel,
        state: ObjectState,
        *,
        modes: bool,
        free_form: bool,
        velocity: bool = False,
        runs: int,
    ) -> list[float]:
        """Seconds of each of `runs` evaluations of residuals, Jacobians and normal equations."""
        with geometry_errors():
            return self._template.time(
                _problem(views, ground, noise, state, modes=modes, free_form=free_form, velocity=velocity),
                runs,
            )

    def uncertainty(
        self,
        views: Sequence[View],
        ground: GroundPlane | None,
        noise: NoiseModel,
        state: ObjectState,
        *,
        modes: bool,
        free_form: bool,
        velocity: bool = False,
        per_vertex: bool = True,
    ) -> tuple[Floats, Floats, Bools]:
        """Covariance (6, 6) of the pose at the mesh's centre, sigma (V,) of each vertex in metres, which were observed.

        GeometryError where nothing holds a parameter.
        """
        with geometry_errors():
            return self._template.uncertainty(
                _problem(views, ground, noise, state, modes=modes, free_form=free_form, velocity=velocity),
                per_vertex,
            )

    def covariance(
        self,
        views: Sequence[View],
        ground: GroundPlane | None,
        noise: NoiseModel,
        state: ObjectState,
        blocks: Sequence[Block],
        *,
        modes: bool,
        free_form: bool,
        velocity: bool = False,
    ) -> Floats:
        """Joint covariance (n, n) of blocks of parameters in the order named, the inverse of the normal matrix there.

        Pose is a right perturbation of world_from_object at its origin (translation m, rotation rad); modes are in
        standard deviations, free form in metres, velocity in m/s. GeometryError where nothing holds a parameter, or for
        a block that is not estimated.
        """
        with geometry_errors():
            return self._template.covariance(
                _problem(views, ground, noise, state, modes=modes, free_form=free_form, velocity=velocity),
                list(blocks),
            )

    def square_root(
        self,
        view: View,
        noise: NoiseModel,
        camera_from_object: Pose,
        z: Floats | None = None,
        *,
        modes: bool = False,
    ) -> SquareRoot:
        """Linearize a view at a relative pose (the view's own pose and time are not used), with `modes` also over z.

        Without z (modes,), in standard deviations, the mean shape is meant. GeometryError for a shape that does not
        fit, or a value that is not finite.
        """
        weights = np.zeros(self.mode_count) if z is None else z
        with geometry_errors():
            root, cost, observations = self._template.square_root(
                view, noise, floats(camera_from_object.matrix), floats(weights), np.zeros(0), modes
            )
        return SquareRoot(root, cost, observations)

    def square_roots(
        self,
        views: Sequence[View],
        noise: NoiseModel,
        rotations: Floats,
        translations: Floats,
        z: Floats | None = None,
    ) -> list[SquareRoot]:
        """As `square_root` of n views at camera_from_object (n, 3, 3) and (n, 3), over z (n, modes) where it is given.

        The views share the threads; results do not depend on how many there are.
        """
        weights = np.zeros((len(views), self.mode_count)) if z is None else z
        rows = np.concatenate([rotations.reshape(-1, 9), translations], axis=1)
        with geometry_errors():
            roots, costs, observations = self._template.square_roots(
                list(views), noise, floats(rows), floats(weights), z is not None
            )
        return [SquareRoot(*each) for each in zip(roots, costs, observations, strict=True)]

    def border_distances_px(self, views: Sequence[View], state: ObjectState, step_px: float) -> list[Floats]:
        """Signed distance, pixels, from each border point to the outline, in the points' order, an array a view.

        Positive where the outline lies outside; NaN where the border is not the object's own. GeometryError for a state
        that does not fit, or a step that is not positive.
        """
        with geometry_errors():
            return self._template.border_distances(list(views), _native(state), step_px)

    def mask_ious(self, views: Sequence[View], poses: Sequence[Pose], vertices: Floats) -> Floats:
        """IoU (poses, views) of the drawn mesh with the observed masks; hidden pixels count only where observed.

        Poses are world_from_object, vertices (V, 3) in metres. GeometryError for a wrong shape, or a value that is not
        finite.
        """
        with geometry_errors():
            return self._template.mask_ious(list(views), [floats(p.matrix) for p in poses], floats(vertices))


def _problem(
    views: Sequence[View],
    ground: GroundPlane | None,
    noise: NoiseModel,
    state: ObjectState,
    *,
    modes: bool,
    free_form: bool,
    velocity: bool,
) -> _core.Problem:
    """What the core takes as one."""
    return _core.Problem(
        views=list(views),
        ground=ground,
        noise=noise,
        modes=modes,
        free_form=free_form,
        velocity=velocity,
        state=_native(state),
    )


def _native(state: ObjectState) -> _core.ObjectState:
    return _core.ObjectState(
        world_from_object=floats(state.world_from_object.matrix),
        z=floats(state.z),
        d=floats(state.d),
        velocity=floats(state.velocity),
    )
