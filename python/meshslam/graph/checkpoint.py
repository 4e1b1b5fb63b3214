"""A run's state before a call, so that a call that fails changes nothing.

The walk goes through everything below `meshslam` that can change: objects, lists, dicts, sets, GTSAM's values. It
copies containers, not what they hold: arrays, frozen data and factors are never changed in place. What only grows says
how to take itself back (`checkpoint`), so that the cost per frame does not grow with the run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import is_dataclass
from typing import Any

import gtsam

from meshslam.errors import MeshslamError, SequenceError
from meshslam.graph.tags import ObservationTag

Undo = Callable[[], None]


class Checkpoint:
    """The state of everything below `root`, as it is now."""

    def __init__(self, root: object) -> None:
        """Walk once; `restore` brings back what was found."""
        self._undo: list[Undo] = []
        seen: set[int] = set()
        pending: list[Any] = [root]
        while pending:
            thing = pending.pop()
            if id(thing) not in seen:
                seen.add(id(thing))
                pending += [held for held in self._keep(thing) if _can_change(type(held))]

    def restore(self) -> None:
        """Bring everything back, in place: references from elsewhere stay right."""
        for undo in self._undo:
            undo()

    def _keep(self, thing: Any) -> list[Any]:  # noqa: ANN401 # whatever a run holds
        """Note how a thing is brought back; returns what it holds."""
        if isinstance(thing, dict):
            self._undo.append(_dict_undo(thing))
            return list(thing.values())
        if isinstance(thing, list):
            held = list(thing)
            self._undo.append(lambda: thing.__setitem__(slice(None), held))
            return held
        if isinstance(thing, set):
            self._undo.append(_set_undo(thing))
            return []
        if isinstance(thing, gtsam.Values):
            self._undo.append(_values_undo(thing))
            return []
        if hasattr(thing, "checkpoint"):
            self._undo.append(thing.checkpoint())
            return []
        if isinstance(thing, ObservationTag):  # which is frozen, but holds a cost that is not
            self._undo.append(_dict_undo(vars(thing.cost)))
            return []
        attributes = vars(thing)
        self._undo.append(_dict_undo(attributes))
        return list(attributes.values())


@contextmanager
def unchanged_by_errors(run: object, what: str) -> Iterator[None]:
    """Bring a run back to where it was if the block raises; what is no MeshslamError becomes a SequenceError."""
    before = Checkpoint(run)
    try:
        yield
    except MeshslamError:
        before.restore()
        raise
    except Exception as error:
        before.restore()
        said = " ".join(str(error).split())[:150]
        raise SequenceError(
            f"{what}: {type(error).__name__}: {said}; the state is as before this call: go on with the next frame, or "
            "try once more"
        ) from error
    except BaseException:
        before.restore()
        raise


@contextmanager
def unchanged(run: object) -> Iterator[None]:
    """Bring a run back to where it was, whatever the block does to it."""
    before = Checkpoint(run)
    try:
        yield
    finally:
        before.restore()


_KNOWN: dict[type, bool] = {dict: True, list: True, set: True, gtsam.Values: True, ObservationTag: True}


def _can_change(kind: type) -> bool:
    """Whether instances of a type are walked."""
    known = _KNOWN.get(kind)
    if known is None:
        frozen = is_dataclass(kind) and kind.__dataclass_params__.frozen  # type: ignore[attr-defined] # of dataclasses
        known = _KNOWN[kind] = kind.__module__.startswith("meshslam.") and not frozen and kind.__dictoffset__ != 0
    return known


def _dict_undo(thing: dict[Any, Any]) -> Undo:
    held = dict(thing)

    def undo() -> None:
        thing.clear()
        thing.update(held)

    return undo


def _set_undo(thing: set[Any]) -> Undo:
    held = set(thing)

    def undo() -> None:
        thing.clear()
        thing.update(held)

    return undo


def _values_undo(thing: gtsam.Values) -> Undo:
    held = gtsam.Values(thing)

    def undo() -> None:
        thing.clear()
        thing.insert(held)

    return undo
