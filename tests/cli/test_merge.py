"""`merge`: several runs become one map."""

import json
import os
import shutil
import signal

import pytest

from meshslam.errors import MapError
from meshslam.geometry import Pose
from meshslam.maps import Map, Trajectory, read_figures
from meshslam.perception import write_detections
from meshslam.runs import Config, Outlet, read_config, run_merge
from meshslam.sequences import camera_yaml
from tests.cli.conftest import begin, done, error_of, meshslam
from tests.merging.conftest import as_set, camera, camera_path, car, car_detection, drive_by, seen_cars, street

__all__ = ["as_set", "camera", "car", "car_detection", "drive_by", "seen_cars", "street"]
WRITTEN = ("config.yaml", "drives.json", "map.json", "merge.html", "metrics.json", "visits.json")


def write_run(drive, folder):
    """A run's folder, as `map` writes it."""
    drive.map.save(folder)
    drive.trajectory.save(folder / "trajectory.tum")
    if drive.views is not None:
        (folder / "detections.json").write_bytes(write_detections(drive.views.detections))
        (folder / "camera.yaml").write_text(camera_yaml(drive.views.camera, None, None, 1.65))
    return folder


@pytest.fixture(scope="module")
def runs(street, drive_by, seen_cars, tmp_path_factory):
    """Two passes of one street, the second without the car 5, and one of another street."""
    folder, path = tmp_path_factory.mktemp("runs"), camera_path(30)
    cars = street(2, 8)
    later = {k: v for k, v in cars.items() if k != 5}
    one, _ = drive_by("monday", cars, 1, views=seen_cars(cars, path), path=path)
    two, _ = drive_by("tuesday", later, 2, views=seen_cars(later, path), path=path)
    other, _ = drive_by("elsewhere", street(77, 8, 8.1), 3)
    return tuple(write_run(drive, folder / drive.name) for drive in (one, two, other))


@pytest.fixture(scope="module")
def city(runs, tmp_path_factory):
    """All three merged, and what was said."""
    out = tmp_path_factory.mktemp("merged") / "city"
    return out, done("merge", *runs, "--out", out)


def test_drives_become_one_map_with_visits_and_drives(runs, city):
    out, said = city
    assert all((out / name).is_file() for name in WRITTEN)
    assert len(Map.load(out)) == 7
    assert len(Map.load(out / "gone")) == 1
    assert len(Trajectory.load(out / "trajectories" / "tuesday.tum")) == 30
    drives = json.loads((out / "drives.json").read_text())["drives"]
    assert [d["name"] for d in drives] == ["monday", "tuesday"]
    assert [d["how"] for d in drives] == ["world", "constellation"]
    assert Pose.from_matrix(drives[1]["world_from_drive"])
    visits = json.loads((out / "visits.json").read_text())
    [gone] = [entry for entry in visits["cars"] if entry["status"] == "gone"]
    assert [visit["status"] for visit in gone["visits"]] == ["seen", "gone"]
    assert gone["visits"][0]["id"] == 5
    assert read_figures(out)["cars_gone"] == 1
    assert "drives in one world" in said.stdout
    assert "gone since tuesday" in said.stderr


def test_a_drive_of_another_street_is_kept_in_a_world_of_its_own(city):
    out, said = city
    assert len(Map.load(out / "world-2")) == 8
    assert "elsewhere: not laid on the others, kept in world-2" in said.stderr


def test_the_page_names_what_happened(city):
    page = (city[0] / "merge.html").read_text()
    assert page.count("<polygon") == 8
    assert "tuesday" in page


def test_the_same_runs_give_the_same_bytes_in_any_order(runs, city, tmp_path):
    done("merge", *reversed(runs), "--out", tmp_path / "again", "--quiet")
    for name in ("map.json", "visits.json", "drives.json", "merge.html", "trajectories/tuesday.tum"):
        assert (tmp_path / "again" / name).read_bytes() == (city[0] / name).read_bytes(), name


def test_figures_as_json_and_nothing_laid_is_3(runs, tmp_path):
    result = meshslam("merge", runs[0], runs[2], "--out", tmp_path / "city", "--json")
    assert result.returncode == 3
    assert json.loads(result.stdout)["worlds"] == 2


def test_worlds_that_are_one_already_are_said_by_a_flag_or_a_setting(runs, tmp_path):
    done("merge", runs[0], runs[2], "--out", tmp_path / "flag", "--poses", "global", "--no-views", "--quiet")
    (tmp_path / "settings.yaml").write_text("merging:\n  poses: global\n  use_views: false\n")
    settings = read_config(tmp_path / "settings.yaml", "merge")
    run_merge((runs[0], runs[2]), settings, tmp_path / "file", Outlet(), overwrite=False)
    assert (tmp_path / "flag" / "map.json").read_bytes() == (tmp_path / "file" / "map.json").read_bytes()
    assert not (tmp_path / "flag" / "world-2").exists()


def test_mistakes_are_told(runs, city, tmp_path):
    out = tmp_path / "city"
    assert "two runs or more" in error_of(meshslam("merge", runs[0], "--out", out))
    assert "merging.poses" in error_of(meshslam("merge", *runs, "--out", out, "--poses", "somehow"))
    assert "--overwrite" in error_of(meshslam("merge", *runs, "--out", city[0]))
    with pytest.raises(MapError, match="choose another --out"):
        run_merge(runs, Config(), runs[0], Outlet(), overwrite=True)
    with pytest.raises(MapError, match="given twice"):
        run_merge((runs[0], runs[0]), Config(), out, Outlet(), overwrite=True)
    broken = shutil.copytree(runs[0], tmp_path / "broken")
    lines = (broken / "trajectory.tum").read_text().splitlines(keepends=True)
    (broken / "trajectory.tum").write_text("".join(lines[:-1]))
    with pytest.raises(MapError, match="29 poses"):
        run_merge((broken, runs[1]), Config(), out, Outlet(), overwrite=True)
    (broken / "map.json").write_text("{")
    with pytest.raises(MapError, match=r"broken/map\.json"):
        run_merge((broken, runs[1]), Config(), out, Outlet(), overwrite=True)
    assert not out.exists()


def test_a_run_without_its_views_is_fused_and_said(runs, tmp_path):
    bare = shutil.copytree(runs[1], tmp_path / "bare")
    (bare / "detections.json").unlink()
    said = done("merge", runs[0], bare, "--out", tmp_path / "city").stderr
    assert "bare: no detections.json" in said
    assert len(Map.load(tmp_path / "city")) == 8


def test_an_interrupt_leaves_nothing(runs, tmp_path):
    process = begin("merge", *runs, "--out", tmp_path / "city")
    first = process.stderr.readline()  # the first step's
    os.killpg(process.pid, signal.SIGINT)
    said = first + process.communicate(timeout=60)[1]
    assert process.returncode == 130, said
    assert said.splitlines()[-1].startswith("interrupted")
    assert list(tmp_path.iterdir()) == []
