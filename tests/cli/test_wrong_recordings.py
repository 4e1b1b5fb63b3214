"""Damaged recordings of other layouts end `map` and `convert` in one line, and `check` with the same one."""

import pytest

from tests.cli.conftest import error_of, meshslam
from tests.sequences.test_layouts import colmap, nuscenes
from tests.sequences.test_time_files import lines
from tests.sequences.test_video import COUNT, camera, write


def short_times(folder, rng):
    pytest.importorskip("av")
    path = write(folder / "drive.mp4")
    (folder / "times.txt").write_text(lines(0.1 * i for i in range(COUNT - 1)))
    return path, ["--camera", camera(folder), "--times", folder / "times.txt"], "holds 39 times, but drive.mp4 has 40"


def other_poses(folder, rng):
    nuscenes(folder / "nuscenes", rng)
    (folder / "nuscenes" / "v1.0-mini" / "ego_pose.json").write_text("[]")
    return folder / "nuscenes", ["--scene", "scene-0001"], "5 rows that sample_data.json names are not there"


def lines_of_points_left_out(folder, rng):
    colmap(folder / "project", rng, binary=False)
    file = folder / "project" / "sparse" / "0" / "images.txt"
    file.write_text(lines(line for line in file.read_text().split("\n") if line))
    return folder / "project", [], "line 3: an image stands where the points of the one before it should"


@pytest.mark.parametrize("make", [short_times, other_poses, lines_of_points_left_out])
def test_each_command_says_it_in_one_line(tmp_path, rng, make):
    path, options, said = make(tmp_path, rng)
    out = tmp_path / "out"
    assert said in error_of(meshslam("map", path, "--out", out, "--segmenter", "colour", *options))
    assert said in error_of(meshslam("convert", "recording", path, out, *options))
    assert not (out / "times.txt").exists()
    checked = meshslam("check", path, *options)
    assert checked.returncode == 1
    assert said in checked.stdout
