"""Fleet files: what they mean, and errors that name file, drive and key."""

import os
import re

import pytest
import yaml

from meshslam.errors import ConfigError
from meshslam.fleet import read_fleet


@pytest.fixture
def read(tmp_path):
    """A fleet file of a document, beside three folders and a stray file."""
    for name in ("a 1", "b", "c"):
        (tmp_path / "drives" / name).mkdir(parents=True)
    (tmp_path / "drives" / "README.md").write_text("no drive")
    (tmp_path / "net.onnx").write_text("")

    def reading(document):
        path = tmp_path / "fleet.yaml"
        path.write_text(document if isinstance(document, str) else yaml.safe_dump(document, sort_keys=False))
        return read_fleet(path)

    return reading


def test_a_pattern_is_a_drive_for_each_folder(read, tmp_path):
    found = read({"recordings": "drives/*"}).drives
    assert [drive.name for drive in found] == ["a_1", "b", "c"]
    assert [drive.recording for drive in found] == [str(tmp_path / "drives" / name) for name in ("a 1", "b", "c")]
    assert {drive.command for drive in found} == {"map"}
    assert all(drive.settings.input.sequence == drive.recording for drive in found)
    absolute = read({"drives": [f"{tmp_path}/drives/[bc]"]}).drives
    assert [drive.recording for drive in absolute] == [str(tmp_path / "drives" / name) for name in ("b", "c")]


def test_files_are_drives_where_no_folder_matches(read, tmp_path):
    for name in ("one.mcap", "two.mcap"):
        (tmp_path / name).write_text("")
    assert [drive.name for drive in read(["*.mcap"]).drives] == ["one", "two"]


def test_a_drive_has_its_own_settings_over_the_common_ones(read, tmp_path):
    common = {
        "input": {"segmenter": "net.onnx", "category": "car"},
        "slam": {"lag_s": 7},
        "tracking": {"tracker": "paper"},
    }
    own = {"name": "own", "recording": "drives/b", "command": "slam", "settings": {"input": {"segmenter": "colour"}}}
    mapped, slammed = read({"defaults": {"settings": common}, "drives": ["drives/c", own]}).drives
    assert mapped.settings.input.segmenter == str(tmp_path / "net.onnx")
    assert slammed.settings.input.segmenter == "colour"
    assert slammed.settings.slam.lag_s == 7.0
    assert slammed.settings.tracking.tracker == mapped.settings.tracking.tracker == "paper"


def test_files_of_settings_are_relative_to_the_fleet_file(read, tmp_path, monkeypatch):
    monkeypatch.chdir(os.sep)
    (drive,) = read(
        [{"recording": "drives/b", "settings": {"input": {"poses": "poses.tum", "segmenter": "a-name"}}}]
    ).drives
    assert drive.settings.input.poses == str(tmp_path / "poses.tum")
    assert drive.settings.input.segmenter == "a-name"  # of a network in the store


def test_resources_are_named_by_step(read):
    fleet = read({"recordings": "drives/*", "resources": {"detect": {"cpus": 2, "segmenter": 1}}})
    assert (fleet.needs_of("detect").cpus, fleet.needs_of("detect").others) == (2.0, {"segmenter": 1.0})
    assert fleet.needs_of("detect").threads == 2
    assert fleet.needs_of("map").cpus == 1.0


WRONG = {
    "drives: [": "fleet.yaml: line 1: not valid YAML",
    "{}": "fleet.yaml: no drive is listed",
    "drive: [drives/b]": "fleet.yaml: drive: no such key: there are drives, recordings",
    "recordings: nothing/*": r"fleet.yaml: nothing/\*: recordings: nothing matches",
    "- {name: x}": "fleet.yaml: drive 1: give it `recording`",
    "- {recording: drives/b, recordings: drives/*}": "fleet.yaml: drive 1: give it `recording`",
    "- {recording: drives/b, speed: 3}": "fleet.yaml: drive 1: speed: no such key",
    "- {recordings: drives/*, name: x}": "name: a pattern's drives are named by their folders",
    "- {recording: drives/b, name: ../b}": r"name: '\.\./b' becomes a folder",
    "- {recording: drives/b, command: fly}": "drives/b: command: expected map, localize, slam, found 'fly'",
    "- {recording: drives/b, settings: {slam: {lag_s: 3}}}": "drives/b: settings: map does not use slam.lag_s",
    "- {recording: drives/b, settings: {speeds: 3}}": "drives/b: settings: unknown setting speeds",
    "- {recording: drives/b, settings: 3}": "drives/b: settings: expected settings",
    "- {recording: drives/b, settings: {input: {sequence: x}}}": "input.sequence: the drive's recording takes",
    "- {recording: drives/b, command: localize}": "input.map: localize needs a run",
    "- {name: B, recording: drives/c}\n- drives/b": "two drives are called b",
    "{defaults: {settings: {speeds: 3}}, recordings: drives/*}": "defaults: settings: unknown setting speeds",
    "{resources: {fly: {}}, recordings: drives/*}": "resources: fly: no such key",
    "{resources: {map: {cpus: -1}}, recordings: drives/*}": "resources: map: cpus: expected how many, found -1",
    "{drives: 3}": "drives: expected a list, found 3",
}


@pytest.mark.parametrize("document", WRONG)
def test_what_is_wrong_is_named(read, tmp_path, document):
    with pytest.raises(ConfigError, match=f"^{re.escape(str(tmp_path))}.*{WRONG[document]}"):
        read(document)


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(ConfigError, match="no such fleet file"):
        read_fleet(tmp_path / "fleet.yaml")


def test_patterns_of_urls_are_read_by_fsspec(read, tmp_path):
    pytest.importorskip("fsspec")
    found = read([f"file://{tmp_path}/drives/*"]).drives
    assert [drive.recording for drive in found] == [f"file://{tmp_path}/drives/{name}" for name in ("a 1", "b", "c")]
    with pytest.raises(ConfigError, match="cannot be opened"):
        read([{"recordings": "nosuch://bucket/*"}])
