"""Which objects of a growing map differ from what was shown of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from meshslam.maps import Map, MapObject

MOVED_M = 0.01  # of any vertex, from which on a mesh is shown again
SIGMA_SHARE = 0.1  # by which any vertex's sigma changed


@dataclass
class ShownObjects:
    """What was shown last; `update` says what is to be shown now.

    Example:
        shown = ShownObjects()
        changed, gone = shown.update(slam.map())  # objects to show, (category, id) to remove

    """

    _shown: dict[int, MapObject] = field(default_factory=dict)

    def update(self, current: Map) -> tuple[list[MapObject], list[tuple[str, int]]]:
        """Objects that are new or changed since they were shown, and those that went, by category and id."""
        changed = [thing for thing in current.objects if self._differs(thing)]
        gone = [(thing.category, number) for number, thing in self._shown.items() if number not in current]
        renamed = [
            (self._shown[t.id].category, t.id)
            for t in changed
            if t.id in self._shown and self._shown[t.id].category != t.category
        ]
        for _, number in gone:
            del self._shown[number]
        self._shown |= {thing.id: thing for thing in changed}
        return changed, gone + renamed

    def all(self) -> Iterable[MapObject]:
        """Everything that is shown."""
        return tuple(self._shown.values())

    def forget(self) -> None:
        """Begin anew."""
        self._shown.clear()

    def _differs(self, thing: MapObject) -> bool:
        before = self._shown.get(thing.id)
        if before is None or before.category != thing.category or before.vertices.shape != thing.vertices.shape:
            return True
        if before.faces.shape != thing.faces.shape or not np.array_equal(before.faces, thing.faces):
            return True
        if np.abs(before.vertices_in_world - thing.vertices_in_world).max() > MOVED_M:
            return True
        old, new = before.vertex_sigma_m, thing.vertex_sigma_m
        if old is None or new is None:
            return old is not new
        return bool((np.abs(new - old) > SIGMA_SHARE * np.maximum(old, 1e-3)).any())
