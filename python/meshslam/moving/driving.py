"""How a vehicle drives between two times: its rear axle moves along its heading on an arc (Ackermann steering)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats, hat
from meshslam.moving.config import MovingConfig
from meshslam.moving.path_state import NODE_WIDTH, PathState

_ROWS = 5  # along, across, heading, speed, curvature
_LEAST_SIGMA_M = 0.005
_LEAST_SIGMA_RAD = 0.002


@dataclass(frozen=True, eq=False)
class Driving:
    """The constant-turn model over n times; speed and curvature are random walks.

    Of a speed that is a Brownian motion with density a, whose values at both ends are given, the way between has the
    mean of both times dt and the variance a^2 dt^3 / 12.
    """

    intervals_s: Floats  # (n - 1,)
    rear_axle_m: float  # x of the rear axle in object
    config: MovingConfig

    @property
    def sigmas(self) -> Floats:
        """Standard deviations (n - 1, 5) of way along and across, heading, speed and curvature."""
        dt, c = self.intervals_s, self.config
        return np.column_stack(
            [
                np.hypot(c.acceleration * np.sqrt(dt**3 / 12), _LEAST_SIGMA_M),
                np.hypot(c.slip * np.sqrt(dt), _LEAST_SIGMA_M),
                np.hypot(c.turning * np.sqrt(dt), _LEAST_SIGMA_RAD),
                c.acceleration * np.sqrt(dt),
                c.steering * np.sqrt(dt),
            ]
        )

    def residuals(self, state: PathState) -> Floats:
        """Residuals (n - 1, 5), in standard deviations."""
        way, turn = _ways(state, self.rear_axle_m), _turns(state)
        ahead, left = _axes(state, turn)
        driven = _means(state.speeds_m_s) * self.intervals_s
        rows = [
            (ahead * way).sum(1) - driven * np.sinc(turn / (2 * np.pi)),
            (left * way).sum(1),
            turn - _means(state.curvatures) * driven,
            np.diff(state.speeds_m_s),
            np.diff(state.curvatures),
        ]
        found: Floats = np.column_stack(rows) / self.sigmas
        return found

    def jacobians(self, state: PathState) -> Floats:
        """Derivatives (n - 1, 5, 16) of the residuals over the steps of both nodes."""
        way, turn = _ways(state, self.rear_axle_m), _turns(state)
        ahead, left = _axes(state, turn)
        speed, curvature, dt = _means(state.speeds_m_s), _means(state.curvatures), self.intervals_s
        by_place, by_heading = _rear_axle_derivative(state, self.rear_axle_m), _heading_derivative(state)
        out = np.zeros((len(dt), _ROWS, 2 * NODE_WIDTH))
        for node, sign in ((0, -1.0), (1, 1.0)):
            at = slice(node, len(state) - 1 + node)
            moved, turned = sign * by_place[at], by_heading[at]
            block = out[:, :, node * NODE_WIDTH : (node + 1) * NODE_WIDTH]
            block[:, 0, :6] = np.einsum("ni,nij->nj", ahead, moved) + 0.5 * (left * way).sum(1)[:, None] * turned
            block[:, 1, :6] = np.einsum("ni,nij->nj", left, moved) - 0.5 * (ahead * way).sum(1)[:, None] * turned
            block[:, 0, :6] -= (sign * speed * dt * _sinc_derivative(turn))[:, None] * turned
            block[:, 0, 6] = -0.5 * dt * np.sinc(turn / (2 * np.pi))
            block[:, 2, :6] = sign * turned
            block[:, 2, 6], block[:, 2, 7] = -0.5 * curvature * dt, -0.5 * speed * dt
            block[:, 3, 6] = block[:, 4, 7] = sign
        found: Floats = out / self.sigmas[..., None]
        return found


def _means(values: Floats) -> Floats:
    found: Floats = 0.5 * (values[1:] + values[:-1])
    return found


def _ways(state: PathState, rear_axle_m: float) -> Floats:
    """Ways (n - 1, 2) of the rear axle's middle over the ground."""
    rear = state.translations + rear_axle_m * state.rotations[:, :, 0]
    return np.diff(rear[:, :2], axis=0)


def _headings(state: PathState) -> Floats:
    return np.arctan2(state.rotations[:, 1, 0], state.rotations[:, 0, 0])


def _turns(state: PathState) -> Floats:
    """Turns (n - 1,) of the heading, from -pi to pi."""
    found: Floats = (np.diff(_headings(state)) + np.pi) % (2 * np.pi) - np.pi
    return found


def _axes(state: PathState, turn: Floats) -> tuple[Floats, Floats]:
    """Unit vectors (n - 1, 2) along the chord of each arc and to its left: the chord has the mean heading."""
    middle = _headings(state)[:-1] + 0.5 * turn
    c, s = np.cos(middle), np.sin(middle)
    return np.column_stack([c, s]), np.column_stack([-s, c])


def _sinc_derivative(turn: Floats) -> Floats:
    """Derivative (n,) of sin(turn / 2) / (turn / 2) over the turn."""
    half = 0.5 * turn
    small = np.abs(half) < 1e-3
    safe = np.where(small, 1.0, half)
    found: Floats = 0.5 * np.where(small, -half / 3, (np.cos(safe) * safe - np.sin(safe)) / safe**2)
    return found


def _rear_axle_derivative(state: PathState, rear_axle_m: float) -> Floats:
    """Derivatives (n, 2, 6) of the rear axle's place on the ground over a pose's step."""
    arm = hat(np.array([rear_axle_m, 0.0, 0.0]))
    found: Floats = np.concatenate([state.rotations, -state.rotations @ arm], axis=2)[:, :2]
    return found


def _heading_derivative(state: PathState) -> Floats:
    """Derivatives (n, 6) of the heading over a pose's step: R (phi x e1) = phi_z R e2 - phi_y R e3."""
    x, y, z = (state.rotations[:, :2, k] for k in range(3))
    level = (x**2).sum(1)
    out = np.zeros((len(state), 6))
    out[:, 5] = (x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]) / level
    out[:, 4] = -(x[:, 0] * z[:, 1] - x[:, 1] * z[:, 0]) / level
    return out
