import json
import re
import resource
import subprocess
import sys
from importlib.metadata import version as installed_version

import pytest
import yaml

from meshslam.maps import Map, Trajectory
from tests.cli.conftest import done, error_of, estimate, meshslam

COMMANDS = (
    ["map"],
    ["detect"],
    ["check"],
    ["evaluate"],
    ["compare"],
    ["demo"],
    ["simulate"],
    ["reproduce"],
    ["version"],
    ["category"],
    ["category", "list"],
)


SMALLEST = """
import typer
app = typer.Typer()
@app.command()
def hello(name: str = typer.Option("you", help="whom")): ...
app()
"""


def timed(call):
    """What a call gives, and the seconds of CPU that its processes took."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    given = call()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return given, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


@pytest.mark.parametrize("command", [[], *COMMANDS], ids=" ".join)
def test_help_answers_at_once_with_an_example(command):
    shown, cpu_s = timed(lambda: done(*command, "--help").stdout)
    if cpu_s >= 0.7:  # this machine is slow now, or we are: a program that does nothing else takes as long, or not
        cpu_s = timed(lambda: done(*command, "--help"))[1]
        assert cpu_s < 3.0 * timed(lambda: subprocess.run([sys.executable, "-c", SMALLEST, "--help"], check=True))[1]
    assert "Usage" in shown
    assert len(command) != 1 or command[0] in ("version", "category", "reproduce") or "Example: meshslam" in shown


def test_the_version_is_a_flag_and_a_command():
    said = done("--version").stdout
    assert said == done("version").stdout == f"{installed_version('meshslam')}\n"
    assert "--version" in done("--help").stdout


def test_help_lists_every_command():
    shown = done("--help").stdout
    assert all(command[0] in shown for command in COMMANDS)


@pytest.mark.parametrize("arguments", [["nonsense"], ["map", "--nonsense"], ["detect"], ["demo", "--seed", "-1"]])
def test_wrong_usage_ends_with_2_and_no_traceback(arguments):
    result = meshslam(*arguments)
    assert result.returncode == 2
    assert "Traceback" not in result.stderr
    assert result.stderr


def test_version_and_categories():
    assert done("version").stdout.strip()[0].isdigit()
    listed = done("category", "list").stdout
    assert all(f"{name}: 642 vertices" in listed for name in ("bus", "car", "truck"))


def test_the_run_directory_is_complete(source, source_run):
    names = {"map.json", "trajectory.tum", "camera.yaml", "detections.json", "metrics.json", "config.yaml"}
    names |= {"manifest.json", "left_out.json", "map.glb", "report.html", "objects"}
    assert {path.name for path in source_run.iterdir()} == names
    found = Map.load(source_run)
    assert len(found) >= 3
    assert {path.name for path in (source_run / "objects").iterdir()} == {f"{o.id}.ply" for o in found.objects}
    assert all(o.vertices.shape == (642, 3) and o.faces.shape == (1280, 3) for o in found.objects)
    document = json.loads((source_run / "detections.json").read_text())
    assert len(Trajectory.load(source_run / "trajectory.tum")) == len(document["images"]) == 6
    tracks = {a.get("track_id") for a in document["annotations"]}
    assert {o.id for o in found.objects} <= tracks
    given = json.loads((source / "detections.json").read_text())["annotations"]
    assert [(a["id"], a["segmentation"]) for a in given] == [
        (a["id"], a["segmentation"]) for a in document["annotations"]
    ]
    assert (source_run / "map.glb").read_bytes()[:4] == b"glTF"
    assert not re.search(r"(src|href)=.?https?:", (source_run / "report.html").read_text())


def test_metrics_name_every_figure(source_run):
    figures = json.loads((source_run / "metrics.json").read_text())
    expected = "objects_mapped tracks frames mask_iou_single_frame mask_iou_category_model mask_iou_pose mask_iou_shape"
    expected += " seconds_total seconds_perception seconds_tracking seconds_mapping milliseconds_per_frame"
    expected += " peak_memory_mb voxel_iou_mean voxel_iou_category_model centre_error_median_m recall"
    assert set(expected.split()) <= figures.keys()
    assert all(isinstance(value, int | float) for value in figures.values())


def test_the_same_command_again_does_nothing_and_says_the_same(source, source_run):
    before = {path: path.stat().st_mtime_ns for path in source_run.rglob("*") if path.is_file()}
    shown = json.loads(done("map", source, "--out", source_run, "--json").stdout)
    assert shown == json.loads((source_run / "metrics.json").read_text())
    assert {path: path.stat().st_mtime_ns for path in source_run.rglob("*") if path.is_file()} == before


def test_a_runs_configuration_repeats_it(source_run, tmp_path):
    done("map", "--config", source_run / "config.yaml", "--out", tmp_path / "again")
    assert estimate(tmp_path / "again") == estimate(source_run)
    assert (tmp_path / "again" / "config.yaml").read_bytes() == (source_run / "config.yaml").read_bytes()


def test_settings_of_a_file_reach_the_run_and_another_configuration_is_refused(source, tmp_path):
    settings, run = tmp_path / "settings.yaml", tmp_path / "run"
    settings.write_text("mapping: {min_views: 99}\n")
    figures = json.loads(done("map", source, "--out", run, "--config", settings, "--json").stdout)
    assert yaml.safe_load((run / "config.yaml").read_text())["mapping"]["min_views"] == 99
    assert figures["objects_mapped"] == 0 or figures["frames"] < 99
    error = error_of(meshslam("map", source, "--out", run))
    assert "config.yaml" in error
    assert "--overwrite" in error
    done("map", source, "--out", run, "--overwrite")
    assert yaml.safe_load((run / "config.yaml").read_text())["mapping"]["min_views"] == 3


@pytest.mark.parametrize("text", ["mapping: {nope: 3}", "mapping: {passes: many}", "nope: 1", "- 1", "a: [", "x: {y"])
def test_a_wrong_configuration_names_file_and_key(source, tmp_path, text):
    settings = tmp_path / "settings.yaml"
    settings.write_text(text)
    error = error_of(meshslam("map", source, "--out", tmp_path / "run", "--config", settings))
    assert str(settings) in error
    assert "nope" in error or "passes" in error or "nope" not in text
    assert not (tmp_path / "run").exists()


def test_a_foreign_folder_is_left_alone(source, tmp_path):
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "dear.txt").write_text("mine")
    for arguments in (["map", source, "--overwrite"], ["demo"]):
        error = error_of(meshslam(*arguments, "--out", tmp_path / "letters"))
        assert "letters" in error
        assert "dear.txt" in error
    assert [path.name for path in (tmp_path / "letters").iterdir()] == ["dear.txt"]
    error_of(meshslam("map", source, "--out", tmp_path / "letters" / "dear.txt"))
    assert (tmp_path / "letters" / "dear.txt").read_text() == "mine"


def test_frames_without_a_pose_are_left_out_of_map_and_report(street, tmp_path):
    lines = (street / "poses.tum").read_text().splitlines()
    (street / "poses.tum").write_text("\n".join(lines[:-1]) + "\n")
    result = done("map", street, "--out", tmp_path / "run", "--json")
    assert json.loads(result.stdout)["frames"] == len(lines) - 1
    assert "1 of 6 frames have no pose" in result.stderr
    assert (tmp_path / "run" / "report.html").is_file()
    assert len((tmp_path / "run" / "trajectory.tum").read_text().splitlines()) == len(lines) - 1


def test_without_truth_the_estimate_is_the_same_bytes(street, source_run, tmp_path):
    for name in ("objects.json", "association.json"):
        (street / name).unlink()
    done("map", street, "--out", tmp_path / "run")
    assert estimate(tmp_path / "run") == estimate(source_run)
    figures = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert not figures.keys() & {"recall", "voxel_iou_mean", "centre_error_median_m"}


def test_damaged_truth_is_named_and_the_map_stays(street, source_run, tmp_path):
    (street / "objects.json").write_text('{"objects": [{"id": 1}]}')
    assert "objects.json" in error_of(meshslam("map", street, "--out", tmp_path / "run"))
    assert estimate(tmp_path / "run") == estimate(source_run)


def test_check_finds_nothing_in_a_sound_recording(source):
    assert "no problem" in done("check", source).stdout


def test_check_lists_every_problem_on_a_line(street):
    (street / "images" / "000002.png").write_bytes((street / "images" / "000002.png").read_bytes()[:1000])
    (street / "images" / "000004.png").write_text("")
    (street / "camera.yaml").write_text("model: pinhole\nresolution: [320, 100]\n")
    (street / "poses.tum").write_text("0 0 0 0 0 0 0 1\n")
    result = meshslam("check", street)
    assert result.returncode == 1
    lines = result.stdout.splitlines()
    for wanted in ("000002.png", "000004.png", "intrinsics", "poses.tum"):
        assert sum(wanted in line for line in lines) >= 1
    assert all(str(street) in line for line in lines)
    assert not result.stderr


def test_check_looks_at_given_detections(source, source_run, tmp_path):
    assert "no problem" in done("check", source, "--detections", source_run / "detections.json").stdout
    document = json.loads((source_run / "detections.json").read_text())
    document["annotations"][0]["viewing_angle_shares"] = [1, 2]
    (tmp_path / "other.json").write_text(json.dumps(document))
    result = meshslam("check", source, "--detections", tmp_path / "other.json")
    assert result.returncode == 1
    assert "other.json: annotations[0] (id 1): viewing_angle_shares" in result.stdout


def test_check_of_a_missing_folder(tmp_path):
    result = meshslam("check", tmp_path / "nowhere")
    assert result.returncode == 1
    assert "no such folder" in result.stdout
