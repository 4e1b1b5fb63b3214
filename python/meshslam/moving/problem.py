"""All that speaks for a path and a shape: views, the road, how vehicles drive, and what shapes there are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from meshslam.geometry import BlockSystem, Floats, NoiseModel, ObjectModel, Pose, SquareRoot, View
from meshslam.moving.driving import Driving
from meshslam.moving.path_state import NODE_WIDTH, PathState
from meshslam.moving.road_contact import RoadContact
from meshslam.moving.shape_prior import ShapePrior

_Add = Callable[[list[int], Floats, Floats], None]


@dataclass(frozen=True, eq=False)
class Linearized:
    """A state with its views' square roots there."""

    state: PathState
    roots: tuple[SquareRoot, ...]
    cost: float


@dataclass(frozen=True, eq=False)
class PathProblem:
    """A cost over a `PathState`, half a squared Mahalanobis distance but for robust kernels."""

    model: ObjectModel
    noise: NoiseModel
    views: Sequence[View]
    nodes: tuple[int, ...]  # of each view
    world_from_camera: tuple[Pose, ...]  # of each view
    driving: Driving
    road: RoadContact | None
    shapes: ShapePrior
    modes: bool  # whether they are estimated, else they stay as they are

    def linearized(self, state: PathState) -> Linearized:
        """The cost at a state, and what its normal equations need of the views."""
        rotations, translations = self._relative(state)
        z = np.tile(state.z, (len(self.views), 1))
        roots = self.model.square_roots(self.views, self.noise, rotations, translations, z)
        others = self._prior_residuals(state)
        cost = sum(root.cost for root in roots) + 0.5 * float(others @ others)
        return Linearized(state, tuple(roots), cost)

    def system(self, at: Linearized, damping: float) -> BlockSystem:
        """The normal equations at a state, its diagonal raised by a share."""
        state = at.state
        count, shape = len(state), len(state)
        widths = dict.fromkeys(range(count), NODE_WIDTH) | ({shape: len(state.z)} if self.modes else {})
        system, diagonal = BlockSystem(widths), _Diagonal(widths)

        def add(numbers: list[int], jacobian: Floats, residual: Floats) -> None:
            system.add_rows(numbers, np.column_stack([jacobian, -residual]))
            diagonal.add(numbers, jacobian)

        for node, root in zip(self.nodes, at.roots, strict=True):
            jacobian, width = root.root[:, :-1], len(root.root) - 1
            wide = np.zeros((width + 1, NODE_WIDTH + width - 6))
            wide[:, :6], wide[:, NODE_WIDTH:] = jacobian[:, :6], jacobian[:, 6:]
            numbers = [node, shape] if self.modes else [node]
            add(numbers, wide if self.modes else wide[:, :NODE_WIDTH], root.root[:, -1])
        self._add_driving(state, add)
        self._add_road(state, add)
        if self.modes:
            add([shape], self.shapes.root, self.shapes.residuals(state.z))
        if damping > 0:
            for number, values in diagonal.values.items():
                system.add_rows([number], np.column_stack([np.diag(np.sqrt(damping * values)), np.zeros(len(values))]))
        return system

    def _add_driving(self, state: PathState, add: _Add) -> None:
        for i, (jacobian, residual) in enumerate(
            zip(self.driving.jacobians(state), self.driving.residuals(state), strict=True)
        ):
            add([i, i + 1], jacobian, residual)
        first = np.zeros((2, NODE_WIDTH))
        first[0, 6], first[1, 7] = 1.0 / self._start_sigmas
        add([0], first, np.array([state.speeds_m_s[0], state.curvatures[0]]) / self._start_sigmas)

    def _add_road(self, state: PathState, add: _Add) -> None:
        if self.road is None:
            return
        own, before, modes = self.road.jacobians(state)
        residuals, shape = self.road.residuals(state), len(state)
        for i in range(len(state)):
            blocks, numbers = ([before[i], own[i]], [i - 1, i]) if i else ([own[i]], [0])
            if self.modes:
                blocks, numbers = [*blocks, modes[i]], [*numbers, shape]
            add(numbers, np.concatenate(blocks, axis=1), residuals[i])

    def _prior_residuals(self, state: PathState) -> Floats:
        first = np.array([state.speeds_m_s[0], state.curvatures[0]]) / self._start_sigmas
        road = np.zeros(0) if self.road is None else self.road.residuals(state).ravel()
        return np.concatenate([self.driving.residuals(state).ravel(), first, road, self.shapes.residuals(state.z)])

    @property
    def _start_sigmas(self) -> Floats:
        return np.array([self.driving.config.speed_sigma_m_s, self.driving.config.curvature_sigma])

    def _relative(self, state: PathState) -> tuple[Floats, Floats]:
        """camera_from_object of each view: rotations (k, 3, 3), translations (k, 3)."""
        turns = np.array([pose.rotation for pose in self.world_from_camera])
        places = np.array([pose.translation for pose in self.world_from_camera])
        nodes = list(self.nodes)
        back = turns.transpose(0, 2, 1)
        moved = (back @ (state.translations[nodes] - places)[..., None])[..., 0]
        return np.ascontiguousarray(back @ state.rotations[nodes]), np.ascontiguousarray(moved)


class _Diagonal:
    """The diagonal of the normal equations, by variable."""

    def __init__(self, widths: dict[int, int]) -> None:
        self.values = {number: np.full(width, 1e-9) for number, width in widths.items()}

    def add(self, numbers: list[int], jacobian: Floats) -> None:
        start, squares = 0, np.square(jacobian).sum(0)
        for number in numbers:
            values = self.values[number]
            values += squares[start : start + len(values)]
            start += len(values)
