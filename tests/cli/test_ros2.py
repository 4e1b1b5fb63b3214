"""`meshslam ros2` apart from ROS: its arguments, and what it says where the extra is missing."""

import importlib.util
from types import SimpleNamespace

import pytest
import typer

from meshslam.cli.ros2 import ROS_ARGUMENTS, RosCommand, ros2
from tests.cli.conftest import error_of, meshslam


@pytest.mark.parametrize(
    ("given", "own", "of_ros"),
    [
        (["--imu", "/imu"], ["--imu", "/imu"], []),
        (["--imu", "/imu", "--ros-args", "-p", "a:=1"], ["--imu", "/imu"], ["--ros-args", "-p", "a:=1"]),
        (["--ros-args", "-p", "a:=1", "--", "--imu", "/imu"], ["--imu", "/imu"], ["--ros-args", "-p", "a:=1"]),
        (["--ros-args", "--log-level", "debug"], [], ["--ros-args", "--log-level", "debug"]),
    ],
)
def test_arguments_of_ros_are_kept_apart(monkeypatch, given, own, of_ros):
    context, rest = SimpleNamespace(meta={}), []
    monkeypatch.setattr(typer.core.TyperCommand, "parse_args", lambda self, ctx, args: rest.extend(args) or args)
    RosCommand("ros2", callback=ros2).parse_args(context, list(given))
    assert (rest, context.meta[ROS_ARGUMENTS]) == (own, of_ros)


@pytest.mark.skipif(importlib.util.find_spec("rclpy") is not None, reason="the extra ros2 is installed")
def test_without_the_extra_the_way_out_is_said(tmp_path):
    result = meshslam("ros2", "--segmenter", "colour", "--out", tmp_path / "run")
    assert "no rclpy" in error_of(result)
    assert "pip install 'meshslam[ros2]'" in error_of(result)
    assert not (tmp_path / "run").exists()


def test_a_mistyped_option_is_an_error():
    assert "No such option" in meshslam("ros2", "--imagee", "/x").stderr
