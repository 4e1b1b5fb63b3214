"""Levenberg-Marquardt over a path and a shape: a step is taken only if the true cost falls."""

from __future__ import annotations

import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry import Floats
from meshslam.moving.path_state import NODE_WIDTH, PathState
from meshslam.moving.problem import Linearized, PathProblem

_ITERATIONS = 40
_REJECTIONS = 6
_LEAST_DECREASE = 0.1  # of the cost, in a step
_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-2, 1e-6, 1e6


def solve(problem: PathProblem, start: PathState) -> Linearized:
    """The best state seen, converged or not."""
    at, damping = problem.linearized(start), _DAMPING
    for _ in range(_ITERATIONS):
        found, damping = _better(problem, at, damping)
        if found is None:
            return at
        fallen, at = at.cost - found.cost, found
        if fallen < _LEAST_DECREASE:
            return at
    return at


def _better(problem: PathProblem, at: Linearized, damping: float) -> tuple[Linearized | None, float]:
    """A state that costs less, and the damping to go on with."""
    for _ in range(_REJECTIONS):
        step = _step(problem, at, damping)
        trial = None if step is None else problem.linearized(at.state.retract(step))
        if trial is not None and trial.cost < at.cost:
            return trial, max(_LEAST_DAMPING, damping / 5)
        damping = min(_MOST_DAMPING, 10 * damping)
    return None, damping


def _step(problem: PathProblem, at: Linearized, damping: float) -> Floats | None:
    """The damped step; None where rounding makes the equations singular."""
    try:
        return problem.system(at, damping).solve().step
    except GeometryError:
        return None


def covariances(problem: PathProblem, at: Linearized) -> tuple[Floats, Floats]:
    """Joint covariances (n, 8 + modes, 8 + modes) of each node with the shape, and that of the shape (modes, modes).

    GeometryError where nothing holds a parameter.
    """
    count = len(at.state)
    last = [count] if problem.modes else []
    groups = [[i, *last] for i in range(count)]
    found = np.array(problem.system(at, 0.0).covariances(groups, last))
    return found, found[0, NODE_WIDTH:, NODE_WIDTH:]
