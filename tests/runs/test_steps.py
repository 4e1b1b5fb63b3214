"""A run in steps writes what the command writes; what is kept from step to step is not computed again."""

import json
import shutil
from dataclasses import replace

import pytest

from meshslam.categories import load_category
from meshslam.maps import FRAMES
from meshslam.perception import ColourSegmenter
from meshslam.runs import DETECT, RUNS, TRACK, Config, Outlet, overlaid, run_step
from meshslam.simulation import StreetConfig, make_street, write_recording
from tests.faults.harness import contents
from tests.perception.networks import colour_network

SMALL = StreetConfig(frames=6, width_px=320, height_px=100, focal_px=190.0, cars_each_side=2, speed_m_s=15.0)


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    folder = tmp_path_factory.mktemp("steps")
    made = write_recording(make_street(load_category("car"), 1, SMALL), folder / "street")
    (made / "detections.json").unlink()
    colour_network(folder / "net.onnx")
    return made


@pytest.fixture(autouse=True)
def seeing(monkeypatch):
    """The tiny network stands for one that finds the cars of the coloured street."""
    monkeypatch.setattr(
        "meshslam.runs.perception.choose_segmenter", lambda _r, config, _o: ColourSegmenter(config.colour)
    )


@pytest.fixture
def settings(drive):
    chosen = {"input": {"sequence": str(drive), "segmenter": str(drive.parent / "net.onnx")}}
    return overlaid(Config(), chosen, "test")


def stepped(command, settings, out):
    """Every step in turn: their names, and what progress they told."""
    done, told, left = [], [], [DETECT]
    while left:
        step, *left = left
        outlet = Outlet(lambda name, _done, _total: told.append(name))
        found = run_step(step, command, settings, out, outlet, overwrite=False)
        done.append(step)
        left = list(found.left)
    return done, told, found


@pytest.mark.parametrize("command", ["map", "slam"])
def test_steps_write_the_bytes_of_the_command(command, settings, tmp_path):
    done, told, found = stepped(command, settings, tmp_path / "steps")
    RUNS[command](settings, tmp_path / "whole", Outlet(), overwrite=False)
    assert done == [DETECT, TRACK, command]
    assert found.figures is not None
    assert contents(tmp_path / "steps") == contents(tmp_path / "whole")
    assert told.count("track") == SMALL.frames  # once a frame, not again in the last step
    assert not list((tmp_path / "steps" / FRAMES).glob("*"))


def test_a_complete_run_has_no_step_left(settings, tmp_path):
    stepped("map", settings, tmp_path / "run")
    found = run_step(DETECT, "map", settings, tmp_path / "run", Outlet(), overwrite=False)
    assert found.was_there
    assert found.left == ()
    assert found.figures["frames"] == SMALL.frames


def test_given_detections_leave_one_step(drive, settings, tmp_path):
    given = shutil.copytree(drive, tmp_path / "street")
    made = write_recording(make_street(load_category("car"), 1, SMALL), tmp_path / "whole")
    shutil.copy(made / "detections.json", given)
    chosen = replace(settings, input=replace(settings.input, sequence=str(given), segmenter=None))
    done, _, _ = stepped("map", chosen, tmp_path / "run")
    assert done == [DETECT, "map"]


def test_tracks_of_other_settings_are_not_taken(settings, tmp_path):
    out = tmp_path / "run"
    for step in (DETECT, TRACK):
        run_step(step, "map", settings, out, Outlet(), overwrite=False)
    (kept,) = (out / FRAMES).glob("tracks-*.json")
    other = overlaid(settings, {"tracking": {"tracker": "paper"}}, "test")
    run_step(TRACK, "map", other, out, Outlet(), overwrite=True)
    assert len(list((out / FRAMES).glob("tracks-*.json"))) == 2
    assert all(len(row) == 2 for row in json.loads(kept.read_text()))


def test_damaged_tracks_are_made_again(settings, tmp_path):
    out, whole = tmp_path / "run", tmp_path / "whole"
    for step in (DETECT, TRACK):
        run_step(step, "map", settings, out, Outlet(), overwrite=False)
    (kept,) = (out / FRAMES).glob("tracks-*.json")
    kept.write_text(kept.read_text()[:-9])
    for folder in (out, whole):
        RUNS["map"](settings, folder, Outlet(), overwrite=False)
    assert contents(out) == contents(whole)


def test_each_step_digests_an_image_once(settings, tmp_path, monkeypatch):
    from meshslam.sequences import image_source

    read, digest = [], image_source.digest_of_file
    monkeypatch.setattr(image_source, "digest_of_file", lambda path: read.append(path) or digest(path))
    left = [DETECT]
    while left:
        read.clear()
        left = list(run_step(left[0], "map", settings, tmp_path / "run", Outlet(), overwrite=False).left)
        assert len(read) == len(set(read)) == SMALL.frames
