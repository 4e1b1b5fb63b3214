"""The examples in the docstrings of geometry say what is true."""

import doctest
import importlib
import inspect
import pkgutil

import pytest

from meshslam import geometry

MODULES = [f"meshslam.geometry.{module.name}" for module in pkgutil.iter_modules(geometry.__path__)]


@pytest.mark.parametrize("name", MODULES)
def test_examples_hold(name):
    assert doctest.testmod(importlib.import_module(name)).failed == 0


def test_public_names_are_sorted_and_each_says_what_it_is():
    assert geometry.__all__ == sorted(set(geometry.__all__))
    for name in geometry.__all__:
        value = getattr(geometry, name)
        if inspect.isfunction(value) or (inspect.isclass(value) and value.__module__.startswith("meshslam.geometry")):
            assert (value.__doc__ or "").count(" ") > 3, name
