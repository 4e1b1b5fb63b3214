"""The wheel and the source distribution, as a user gets them: an empty environment, no compiler, no checkout."""

import json
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

from meshslam.maps import Map
from scripts.try_wheel import LARGEST_BYTES, installed, run_alone
from tests.conftest import REPOSITORY

MATURIN = Path(sys.executable).with_name("maturin")
DATA = ("perception/keypoints/data/car_keypoints.onnx", "py.typed", "_core.pyi", "viewing/assets/report.css")


def built(kind, folder):
    """What maturin makes: of the build that is there, with the same flags."""
    environment = {**os.environ, "VIRTUAL_ENV": str(MATURIN.parent.parent)}
    flags = ["build", "--release", "--quiet"] if kind == "wheel" else ["sdist"]
    command = [MATURIN, *flags, "--out", folder]
    subprocess.run(command, cwd=REPOSITORY, env=environment, check=True, capture_output=True)
    [file] = folder.glob("*.whl" if kind == "wheel" else "*.tar.gz")
    return file


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    return built("wheel", tmp_path_factory.mktemp("wheel"))


def test_one_small_wheel_serves_all_later_versions_of_python(wheel):
    assert re.fullmatch(r"meshslam-[\d.]+-cp311-abi3-(manylinux|macosx|win)\w+\.whl", wheel.name)
    assert wheel.stat().st_size <= LARGEST_BYTES
    names = zipfile.ZipFile(wheel).namelist()
    assert {f"meshslam/{name}" for name in DATA} <= set(names)
    assert not [name for name in names if "tests/" in name or name.endswith((".rs", ".pyc"))]


def test_the_source_distribution_has_all_that_the_build_needs(tmp_path):
    with tarfile.open(built("sdist", tmp_path)) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    needed = {"Cargo.toml", "Cargo.lock", "pyproject.toml", "LICENSE", "README.md", "crates/core/src/lib.rs"}
    assert needed <= names
    assert {f"python/meshslam/{name}" for name in DATA} <= names


def test_every_extra_is_described_and_names_packages_with_lower_bounds():
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    assert {
        "train",
        "ros2",
        "rerun",
        "plots",
        "bags",
        "video",
        "foxglove",
        "usd",
        "parquet",
        "geo",
        "ray",
        "torch",
        "jax",
    } <= set(extras)
    for name in [*project["dependencies"], *(name for found in extras.values() for name in found)]:
        assert re.search(r"[>=]=\d", name), name


def test_the_wheel_alone_maps_finds_itself_again_and_runs_slam(wheel, tmp_path):
    """The demo, whole, as a user's first command is."""
    programs = installed(wheel, tmp_path / "fresh")
    out = tmp_path / "demo"
    runs = json.loads(run_alone(programs, "demo", "--out", out, "--json"))
    mapped, localized, slam = runs["map"], runs["localize"], runs["slam"]
    assert mapped["recall"] == 1.0
    assert mapped["objects_mapped"] == 8
    assert mapped["voxel_iou_mean"] > max(0.88, mapped["voxel_iou_category_model"])
    assert mapped["centre_error_median_m"] < 0.1
    assert localized["ate_rmse_m"] < 0.05
    assert localized["ate_rmse_m"] < localized["ate_initial_rmse_m"]
    assert slam["end_error_percent"] < 1.5
    assert slam["recall"] > 0.8
    assert {path.name for path in out.iterdir()} == {
        "street_0",
        "street_0_again",
        "map",
        "localize",
        "slam",
        "report.html",
    }
    page = (out / "report.html").read_text()
    assert page.count("data:image/jpeg") == 1
    [data] = re.findall(r'<script type="application/json" id="[a-z-]*data">(.*?)</script>', page, re.DOTALL)
    drawn = {thing["id"] for thing in json.loads(data)["scene"]["objects"]}
    assert drawn == {thing.id for thing in Map.load(out / "map").objects}
    for name in runs:
        assert f"{name}/report.html" in page
        assert (out / name / "report.html").stat().st_size > 100_000
