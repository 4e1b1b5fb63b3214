"""Every public name says what it is; the front door's names say units, errors and an example."""

import doctest
import importlib
import inspect
import re
from pathlib import Path

import pytest

import meshslam

PACKAGE = Path(meshslam.__file__).parent
ROOMS = sorted(face.parent.name for face in PACKAGE.glob("*/__init__.py") if face.parent.name != "training")
FRONT_DOOR = sorted(set(meshslam.__all__) - {"__version__"})
ERRORS = re.compile(r"\b[A-Z]\w*Error\b")
SILENT = {"Config"}  # raises nothing of its own


def documented(room):
    """Functions and classes of a room; constants and names of types have no docstring of their own."""
    face = importlib.import_module(f"meshslam.{room}")
    for name in face.__all__:
        value = getattr(face, name)
        if inspect.isfunction(value) or (inspect.isclass(value) and value.__module__.startswith("meshslam.")):
            yield name, value


@pytest.mark.parametrize("room", ROOMS)
def test_every_public_name_of_a_room_says_what_it_is(room):
    for name, value in documented(room):
        said = value.__doc__ or ""
        assert said.count(" ") > 1, f"{room}.{name}"
        assert not said.startswith(f"{name}("), f"{room}.{name}"  # what dataclasses write themselves


@pytest.mark.parametrize("name", FRONT_DOOR)
def test_the_front_door_says_units_errors_and_an_example(name):
    said = getattr(meshslam, name).__doc__
    assert "Example:\n" in inspect.cleandoc(said)
    assert name in SILENT or ERRORS.search(said)
    assert re.search(r"\bmetres\b|\bm and rad\b|\bseconds\b|\bunits\b|_m\b", said)


@pytest.mark.parametrize("name", [n for n in FRONT_DOOR if inspect.isclass(getattr(meshslam, n))])
def test_methods_of_the_front_door_s_classes_say_what_they_do(name):
    for method, value in vars(getattr(meshslam, name)).items():
        if not method.startswith("_") and (callable(value) or isinstance(value, property | staticmethod | classmethod)):
            function = value.fget if isinstance(value, property) else getattr(value, "__func__", value)
            assert (function.__doc__ or "").count(" ") > 1, f"{name}.{method}"


@pytest.mark.parametrize("name", FRONT_DOOR)
def test_examples_of_the_front_door_name_what_exists(name):
    example = inspect.cleandoc(getattr(meshslam, name).__doc__).partition("Example:\n")[2]
    compile(inspect.cleandoc(example), name, "exec")
    for used in re.findall(r"\bmeshslam\.(\w+)", example):
        assert used in meshslam.__all__


@pytest.mark.parametrize("module", ["sequences.sequence", "perception.detections"])
def test_examples_in_docstrings_hold(module):
    names = {"np": importlib.import_module("numpy")}
    assert doctest.testmod(importlib.import_module(f"meshslam.{module}"), extraglobs=names).failed == 0
