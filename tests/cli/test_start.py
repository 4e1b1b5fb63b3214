"""A command that fails on its input ends before what is slow is imported."""

import os
import subprocess
import sys

import pytest

SLOW = ("scipy", "gtsam", "trimesh", "cv2", "matplotlib", "onnxruntime", "numpy")
PROBE = """
import runpy, sys
sys.argv = ["meshslam", *sys.argv[1:]]
try:
    runpy.run_module("meshslam", run_name="__main__", alter_sys=True)
finally:
    print("modules:", *sys.modules)
"""


def _run(*arguments, folder):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "COLUMNS": "200"}
    command = [sys.executable, "-c", PROBE, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder, env=environment, check=False)
    return done, set(done.stdout.rpartition("modules:")[2].split())


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("map", "missing"), 2, "missing: no such folder or file"),
        (("slam", "missing"), 2, "missing: no such folder or file"),
        (("detect", "missing", "--out", "found.json"), 2, "missing: no such folder or file"),
        (("localize", "there", "--map", "missing"), 2, "missing: no such map"),
        (("localize", "missing", "--map", "there/map.json"), 2, "missing: no such folder or file"),
        (("compare", "there", "missing"), 2, "missing: no such run directory"),
        (("evaluate", "missing", "--truth", "there"), 2, "missing: no such run directory"),
        (("evaluate", "there", "--truth", "missing"), 2, "missing: no such truth"),
        (("map", "there", "--config", "missing.yaml"), 2, "missing.yaml: no such configuration file"),
        (("map", "there", "--no-such-option"), 2, "No such option"),
        (("fleet", "run", "missing.yaml", "--out", "out"), 2, "missing.yaml: no such fleet file"),
        (("fleet", "run", "--help"), 0, ""),
        (("--help",), 0, ""),
        (("map", "--help"), 0, ""),
    ],
)
def test_nothing_slow_is_imported_before_the_input_is_looked_for(arguments, code, said, tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "map.json").write_text("{}")
    done, modules = _run(*arguments, folder=tmp_path)
    assert done.returncode == code, done.stderr
    assert said in done.stderr
    assert "typer" in modules
    assert modules.isdisjoint(SLOW)


def test_a_recording_that_cannot_be_read_ends_before_scipy_and_gtsam(tmp_path):
    (tmp_path / "drive").mkdir()
    (tmp_path / "drive" / "camera.yaml").write_text("model: what\n")
    done, modules = _run("map", "drive", "--out", "run", folder=tmp_path)
    assert done.returncode == 2
    assert "numpy" in modules
    assert modules.isdisjoint({"scipy", "gtsam", "trimesh", "onnxruntime"})
