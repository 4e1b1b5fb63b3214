"""The room without its frameworks."""

import importlib
import subprocess
import sys

import pytest

from meshslam.errors import MeshslamError


@pytest.mark.parametrize(("name", "framework"), [("torch", "PyTorch"), ("jax", "JAX")])
def test_a_missing_framework_is_named_with_the_command_that_brings_it(name, framework, monkeypatch):
    for module in [m for m in sys.modules if m.split(".")[:2] == ["meshslam", "autodiff"]]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MeshslamError, match=rf"needs {framework}.*pip install 'meshslam\[{name}\]'"):
        importlib.import_module(f"meshslam.autodiff.{name}")


def test_the_package_imports_no_framework():
    code = "import sys, meshslam, meshslam.autodiff, meshslam.geometry; print({'torch', 'jax'} & set(sys.modules))"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert shown.strip() == "set()"
