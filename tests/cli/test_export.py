import json
import shutil

import pytest
import trimesh

from meshslam.exporting import FORMATS
from meshslam.maps import Map
from tests.cli.conftest import done, error_of, meshslam


def test_a_run_is_exported_in_several_formats_at_once(source_run, tmp_path):
    result = done("export", source_run, "--format", "glb,tum", "-f", "ply", "--out", tmp_path / "handed")
    assert result.stdout.splitlines() == [
        f"{tmp_path}/handed/{name}: {kind}"
        for kind, name in (("glb", "map.glb"), ("tum", "trajectory.tum"), ("ply", "map.ply"))
    ]
    world = trimesh.load_mesh(tmp_path / "handed" / "map.ply")
    assert len(world.faces) == sum(len(thing.faces) for thing in Map.load(source_run).objects)
    assert "--overwrite" in error_of(
        meshslam("export", source_run, "-f", "tum", "--out", tmp_path / "handed" / "map.ply")
    )


def test_images_of_the_recording_are_in_the_log(source_run, tmp_path):
    sizes = []
    for flag in ("--images", "--no-images"):
        file = tmp_path / f"{flag}.mcap"
        assert "no images" not in done("export", source_run, "-f", "mcap", flag, "--out", file).stderr
        sizes.append(file.stat().st_size)
    assert sizes[0] > sizes[1] + 10_000


def test_the_default_place_is_in_the_run_which_stays_complete(source, source_run, tmp_path):
    run = shutil.copytree(source_run, tmp_path / "run")
    done("export", run, "-f", "geojson", "--origin", "49.011,8.416")
    document = json.loads((run / "export" / "map.geojson").read_text())
    assert len(document["features"]) == len(Map.load(run)) + 1
    before = {path: path.stat().st_mtime_ns for path in run.rglob("*") if path.is_file()}
    done("map", source, "--out", run)
    assert {path: path.stat().st_mtime_ns for path in run.rglob("*") if path.is_file()} == before


def test_formats_are_listed_and_what_is_missing_is_said(source_run, tmp_path):
    listed = done("export", "--list").stdout
    assert all(name in listed for name in FORMATS)
    assert "no format is named" in error_of(meshslam("export", source_run))
    assert "no run is named" in error_of(meshslam("export"))
    assert "no such run" in error_of(meshslam("export", tmp_path / "none", "-f", "glb"))
    assert "no finished run" in error_of(meshslam("export", tmp_path, "-f", "glb"))
    assert "expected one of glb" in error_of(meshslam("export", source_run, "-f", "stl"))
    assert "--origin" in error_of(meshslam("export", source_run, "-f", "geojson"))


def test_view_says_where_the_page_is(source_run, tmp_path):
    shown = done("view", source_run, "--no-open").stdout.strip()
    assert shown == (source_run / "report.html").resolve().as_uri()
    assert "no such run" in error_of(meshslam("view", tmp_path / "none"))
    assert "no report.html" in error_of(meshslam("view", tmp_path))


@pytest.mark.parametrize("command", ["export", "view"])
def test_help_has_an_example(command):
    assert f"Example: meshslam {command} run" in " ".join(done(command, "--help").stdout.split())
