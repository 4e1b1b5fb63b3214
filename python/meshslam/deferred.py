"""Faces of rooms that import a module when one of its names is first asked for (PEP 562).

A command waits for what it uses only: `meshslam map missing` ends before SciPy and GTSAM are imported.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def deferred(room: str, names: Mapping[str, str]) -> Callable[[str], Any]:
    """A room's `__getattr__`; `names` are what it hands out, separated by blanks, by the module that has them.

    Type checkers read the imports beside it; `scripts/check_faces.py` holds both against each other.
    """
    module_of = {name: module for module, listed in names.items() for name in listed.split()}

    def found(name: str) -> Any:  # noqa: ANN401 # whatever the module has
        if name not in module_of:
            raise AttributeError(f"module {room!r} has no attribute {name!r}")
        value = getattr(import_module(f"{room}.{module_of[name]}"), name)
        setattr(sys.modules[room], name, value)
        return value

    return found
