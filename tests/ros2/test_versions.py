"""What is said of an installation that does not fit together."""

import pytest

from meshslam.errors import ConfigError
from meshslam.ros2 import check_ros2
from meshslam.ros2.versions import WHEELS

WHOLE = {wheel: f"{begins}6" for wheel, begins in WHEELS.values()}
SOURCED = {"ROS_DISTRO": "jazzy", "AMENT_PREFIX_PATH": "/opt/ros/jazzy"}


def check(environment=None, installed=WHOLE, missing=()):
    return check_ros2(environment or {}, installed.get, lambda module: module not in missing)


def test_wheels_of_one_distribution_go_together():
    assert check() == "jazzy"


@pytest.mark.parametrize("wheel", WHOLE)
def test_a_wheel_of_another_distribution_is_named(wheel):
    with pytest.raises(ConfigError, match=f"{wheel} 99.1.1: not of jazzy.*meshslam\\[ros2\\]"):
        check(installed=WHOLE | {wheel: "99.1.1"})


def test_what_a_newer_distribution_installs_is_found():
    with pytest.raises(ConfigError, match=r"ros-nav-msgs 5\.5\.1"):
        check(installed=WHOLE | {"ros-nav-msgs": "5.5.1"})


@pytest.mark.parametrize("wheel", WHOLE)
def test_a_wheel_that_is_not_there_is_named(wheel):
    with pytest.raises(ConfigError, match=f"{wheel}: not installed"):
        check(installed={k: v for k, v in WHOLE.items() if k != wheel})


def test_without_anything_the_modules_and_the_ways_out_are_named():
    with pytest.raises(ConfigError, match=r"no rclpy, .*pip install 'meshslam\[ros2\]'.*source a ROS 2"):
        check(installed={}, missing=[name for name in WHEELS])


def test_a_sourced_ros_2_is_taken_as_it_is():
    assert check(SOURCED, installed={}) == "jazzy"
    assert check(SOURCED | {"ROS_DISTRO": "kilted"}, installed={}) == "kilted"


def test_a_sourced_ros_2_that_lacks_a_package_is_told():
    with pytest.raises(ConfigError, match=r"sourced ROS 2 \(jazzy\) has no visualization_msgs"):
        check(SOURCED, installed={}, missing=["visualization_msgs"])


def test_a_sourced_ros_2_that_is_too_old_is_told():
    with pytest.raises(ConfigError, match="humble is sourced: the node needs jazzy"):
        check(SOURCED | {"ROS_DISTRO": "humble"}, installed={})


def test_a_sourced_ros_2_beside_wheels_is_told():
    with pytest.raises(ConfigError, match="their libraries do not go together"):
        check(SOURCED)
