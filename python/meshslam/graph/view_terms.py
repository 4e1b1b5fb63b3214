"""All observations of a window at once: the same costs and derivatives as of `object_factor`, one by one.

A camera's derivatives are over X, V, E and T in GTSAM's tangent spaces, an object's over O and Z.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from meshslam.geometry import BlockSystem, Floats, Ints, Pose
from meshslam.graph.object_factor import (
    CameraKeys,
    CameraMemo,
    ObservationCost,
    linearize_all,
    object_factor,
    residuals_all,
)
from meshslam.motion import OURS_FROM_GTSAM, from_pose3

_TOGETHER = 512


@dataclass(frozen=True, eq=False)
class ViewTerm:
    """An observation: which camera it is of, and which object; a pose or a key of one, and that of its modes."""

    cost: ObservationCost
    camera_keys: CameraKeys
    camera_memo: CameraMemo
    world_from_object: Pose | int
    z: int | None

    @property
    def keys(self) -> list[int]:
        """All variables."""
        return [*self.camera_keys, *(key for key in (self.world_from_object, self.z) if isinstance(key, int))]


def view_factor(term: ViewTerm) -> gtsam.CustomFactor:
    """The same observation as one of GTSAM's factors."""
    return object_factor(term.cost, term.camera_keys, term.camera_memo, term.world_from_object, term.z)


class ViewTerms:
    """Observations of a window."""

    def __init__(self, terms: Sequence[ViewTerm]) -> None:
        """Those over the same kinds of variables are evaluated together, as many as the processor's cache holds."""
        kinds: dict[tuple[int, int], list[ViewTerm]] = {}
        for term in terms:
            kinds.setdefault((len(term.keys), 0 if term.z is None else term.cost.model.mode_count), []).append(term)
        self._kinds = [
            _Kind(found[start : start + _TOGETHER])
            for found in kinds.values()
            for start in range(0, len(found), _TOGETHER)
        ]

    def cost(self, values: gtsam.Values) -> float:
        """The sum of their costs."""
        return sum(kind.cost(values) for kind in self._kinds)

    def add_to(self, system: BlockSystem, values: gtsam.Values) -> None:
        """Add their normal equations."""
        for kind in self._kinds:
            system.add_all_rows(kind.keys, kind.rows(values))


class _Kind:
    """Observations over the same kinds of variables."""

    def __init__(self, terms: list[ViewTerm]) -> None:
        self._terms, self.keys = terms, [term.keys for term in terms]
        # a term of each frame, and of each object; and which of these each term is of
        self._frames, self._frame_of = _distinct([term.camera_keys[0] for term in terms])
        self._objects, self._object_of = _distinct([_name(term) for term in terms])
        self._modes = [z for k in self._objects if (z := terms[k].z) is not None]

    def cost(self, values: gtsam.Values) -> float:
        rotation, translation, z = self._relative(values)
        residual = residuals_all([term.cost for term in self._terms], rotation, translation, z)
        return 0.5 * float(np.square(residual).sum())

    def rows(self, values: gtsam.Values) -> Floats:
        """[A b] (n, m, w + 1) of each."""
        rotation, translation, z = self._relative(values)
        by_object, residual = linearize_all([term.cost for term in self._terms], rotation, translation, z)
        by_camera = -by_object[:, :, :6] @ _inverse_adjoint(rotation, translation)
        by_variables = np.array([self._terms[k].camera_memo.last.by_variables for k in self._frames])
        blocks = [by_camera @ by_variables[self._frame_of]]
        if isinstance(self._terms[0].world_from_object, int):
            blocks.append(by_object[:, :, OURS_FROM_GTSAM])
        return np.concatenate([*blocks, by_object[:, :, 6:], -residual[:, :, None]], axis=2)

    def _relative(self, values: gtsam.Values) -> tuple[Floats, Floats, Floats | None]:
        """Rotation (n, 3, 3) and translation (n, 3) of camera_from_object, and modes (n, modes)."""
        cameras = [self._terms[k].camera_memo.place(values, self._terms[k].camera_keys).pose for k in self._frames]
        placed = [_object(self._terms[k], values) for k in self._objects]
        of_camera = np.array([pose.rotation for pose in cameras])[self._frame_of].transpose(0, 2, 1)
        eyes = np.array([pose.translation for pose in cameras])[self._frame_of]
        rotation = of_camera @ np.array([pose.rotation for pose in placed])[self._object_of]
        away = np.array([pose.translation for pose in placed])[self._object_of] - eyes
        z = None
        if self._modes:
            z = np.array([values.atVector(key) for key in self._modes])[self._object_of]
        return rotation, (of_camera @ away[:, :, None])[:, :, 0], z


def _distinct(names: Sequence[int]) -> tuple[list[int], Ints]:
    """Where each name stands first, and which of these each is (n,)."""
    firsts: dict[int, int] = {}
    for k, name in enumerate(names):
        firsts.setdefault(name, k)
    at = {name: i for i, name in enumerate(firsts)}
    return list(firsts.values()), np.array([at[name] for name in names], np.int64)


def _name(term: ViewTerm) -> int:
    """What tells objects apart."""
    fixed = term.world_from_object
    return fixed if isinstance(fixed, int) else id(fixed)


def _object(term: ViewTerm, values: gtsam.Values) -> Pose:
    fixed = term.world_from_object
    return from_pose3(values.atPose3(fixed)) if isinstance(fixed, int) else fixed


def _inverse_adjoint(rotation: Floats, translation: Floats) -> Floats:
    """Adjoints (n, 6, 6) of the inverses of poses, over (translation, rotation)."""
    back = rotation.transpose(0, 2, 1)
    x, y, z = translation.T
    crossed = np.zeros_like(rotation)
    crossed[:, 0, 1], crossed[:, 0, 2], crossed[:, 1, 2] = -z, y, -x
    crossed -= crossed.transpose(0, 2, 1)
    out = np.zeros((len(rotation), 6, 6))
    out[:, :3, :3] = out[:, 3:, 3:] = back
    out[:, :3, 3:] = -back @ crossed  # the cross matrix of -R^T t, times R^T
    return out
