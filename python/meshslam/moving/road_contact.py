"""Wheels stand on the road at every time; what is wrong about the road's height is alike over some metres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.categories import Category
from meshslam.geometry import Floats, GroundPlane
from meshslam.moving.path_state import NODE_WIDTH, PathState

_MOST_ALIKE = 0.999
_LEAST_LEVER_M = 0.1


@dataclass(frozen=True, eq=False)
class Contacts:
    """Mean height, pitch and roll of the wheels, each a weighted sum of points of the mesh."""

    points: Floats  # (3, 3), of the mean mesh, in object
    modes: Floats  # (modes, 3, 3), what a standard deviation of each adds
    levers_m: Floats  # (3,), 0 for the mean height

    @staticmethod
    def of(category: Category) -> Contacts | None:
        """Those of a category; None where it has no wheels."""
        wheels = category.wheel_vertices
        if not len(wheels):
            return None
        points, modes = category.vertices[wheels], category.modes[:, wheels]
        weights, levers = [np.full(len(wheels), 1.0 / len(wheels))], [0.0]
        for axis in (0, 1):
            far = points[:, axis] > points[:, axis].mean()
            weight = np.where(far, 1.0 / max(1, far.sum()), -1.0 / max(1, (~far).sum()))
            lever = float(weight @ points[:, axis])
            weights.append(weight if lever > _LEAST_LEVER_M else np.zeros(len(wheels)))
            levers.append(lever if lever > _LEAST_LEVER_M else 1.0)
        w = np.array(weights)
        return Contacts(w @ points, np.einsum("jw,mwi->mji", w, modes), np.array(levers))

    def at(self, z: Floats) -> Floats:
        """The points (3, 3) of a shape."""
        found: Floats = self.points + np.tensordot(z, self.modes, axes=1)
        return found


@dataclass(frozen=True, eq=False)
class RoadContact:
    """The road below each of n nodes, and how alike its errors are from one to the next.

    u_i are heights in standard deviations; u_0 and (u_i - rho_i u_(i-1)) / sqrt(1 - rho_i^2) are independent.
    """

    contacts: Contacts
    normals: Floats  # (n, 3)
    offsets_m: Floats  # (n,)
    sigmas: Floats  # (n, 3), metres
    alike: Floats  # (n - 1,)

    @staticmethod
    def below(contacts: Contacts, planes: list[GroundPlane], state: PathState, correlation_m: float) -> RoadContact:
        """The road's planes near the nodes of a state."""
        heights = np.array([plane.height_sigma_m for plane in planes])
        tilts = np.array([plane.tilt_sigma_rad for plane in planes])
        sigmas = np.column_stack([heights, *(tilts * lever for lever in contacts.levers_m[1:])])
        apart = np.linalg.norm(np.diff(state.translations, axis=0), axis=1)
        return RoadContact(
            contacts,
            np.array([plane.normal for plane in planes]),
            np.array([plane.offset_m for plane in planes]),
            sigmas,
            np.minimum(np.exp(-apart / correlation_m), _MOST_ALIKE),
        )

    def residuals(self, state: PathState) -> Floats:
        """Independent residuals (n, 3), in standard deviations."""
        return self._independent(self._heights(state))

    def jacobians(self, state: PathState) -> tuple[Floats, Floats, Floats]:
        """Derivatives over each node's own step (n, 3, 8), the node's before (n, 3, 8), and the modes (n, 3, modes)."""
        up = np.einsum("nij,ni->nj", state.rotations, self.normals)  # in object
        points = self.contacts.at(state.z)
        own = np.zeros((len(state), 3, NODE_WIDTH))
        own[:, 0, :3] = up
        own[:, :, 3:6] = np.cross(points[None], up[:, None])
        own /= self.sigmas[..., None]
        modes = np.einsum("mji,ni->njm", self.contacts.modes, up) / self.sigmas[..., None]
        scale, share = self._weights
        before = np.zeros_like(own)
        before[1:] = -share[1:, None, None] * own[:-1]
        mixed = self._independent(modes)
        return own * scale[:, None, None], before, mixed

    @property
    def _weights(self) -> tuple[Floats, Floats]:
        """Factors (n,) of a node's own height, and of the height before."""
        root = np.sqrt(1.0 - self.alike**2)
        return np.concatenate([[1.0], 1.0 / root]), np.concatenate([[0.0], self.alike / root])

    def _heights(self, state: PathState) -> Floats:
        points = self.contacts.at(state.z)
        in_world = np.einsum("nij,kj->nki", state.rotations, points)
        heights = np.einsum("nki,ni->nk", in_world, self.normals)
        heights[:, 0] += (state.translations * self.normals).sum(1) - self.offsets_m
        found: Floats = heights / self.sigmas
        return found

    def _independent(self, values: Floats) -> Floats:
        scale, share = (w.reshape(-1, *[1] * (values.ndim - 1)) for w in self._weights)
        found = scale * values
        found[1:] -= share[1:] * values[:-1]
        return np.asarray(found, float)
