"""Whether what is installed of ROS 2 fits together, before anything of it is loaded."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
from collections.abc import Callable, Mapping

from meshslam.errors import ConfigError

DISTRIBUTION = "jazzy"
WHEELS = {  # of the Python registry, by module: the wheel, and how the distribution's versions begin
    "rclpy": ("ros-rclpy", "7.1."),
    "rcl_interfaces": ("ros-rcl-interfaces", "2.0."),
    "builtin_interfaces": ("ros-builtin-interfaces", "2.0."),
    "std_msgs": ("ros-std-msgs", "5.3."),
    "geometry_msgs": ("ros-geometry-msgs", "5.3."),
    "sensor_msgs": ("ros-sensor-msgs", "5.3."),
    "nav_msgs": ("ros-nav-msgs", "5.3."),
    "visualization_msgs": ("ros-visualization-msgs", "5.3."),
    "diagnostic_msgs": ("ros-diagnostic-msgs", "5.3."),
    "std_srvs": ("ros-std-srvs", "5.3."),
    "rmw_fastrtps_cpp": ("ros-rmw-fastrtps-cpp", "8.4."),
}
_NO_MODULE = {"rmw_fastrtps_cpp"}  # of a sourced ROS 2
OLDEST = ("humble", "iron")  # of which rclpy lacks what the node uses
INSTALL = "install the extra in an environment of its own (pip install 'meshslam[ros2]'), or source a ROS 2"


def _installed(wheel: str) -> str | None:
    try:
        return importlib.metadata.version(wheel)
    except importlib.metadata.PackageNotFoundError:
        return None


def _importable(module: str) -> bool:
    return importlib.util.find_spec(module) is not None


def check_ros2(
    environment: Mapping[str, str] = os.environ,
    installed: Callable[[str], str | None] = _installed,
    importable: Callable[[str], bool] = _importable,
) -> str:
    """The distribution that is installed, such as jazzy; ConfigError, naming the packages, where they do not fit.

    A sourced ROS 2 (`ROS_DISTRO`) is taken as it is, if it has every module. Wheels of the Python registry must all be
    of one distribution: a wheel of another installs without a word, replaces shared parts, and no node can be made.
    """
    missing = [name for name in WHEELS if name not in _NO_MODULE and not importable(name)]
    sourced = environment.get("ROS_DISTRO", "") if environment.get("AMENT_PREFIX_PATH") else ""
    if missing:
        where = f"the sourced ROS 2 ({sourced})" if sourced else "this Python environment"
        raise ConfigError(f"{where} has no {', '.join(missing)}: {INSTALL}")
    found = {wheel: version for wheel, _ in WHEELS.values() if (version := installed(wheel)) is not None}
    if sourced:
        if sourced in OLDEST:
            raise ConfigError(f"ROS 2 {sourced} is sourced: the node needs {DISTRIBUTION} or newer")
        if found:
            names = ", ".join(sorted(found))
            raise ConfigError(
                f"ROS 2 {sourced} is sourced, and the wheels {names} are installed as well: their libraries do not go "
                "together: use a shell that sourced nothing, or an environment without the extra ros2"
            )
        return sourced
    absent = [wheel for wheel, _ in WHEELS.values() if wheel not in found]
    other = [f"{w} {found[w]}" for w, begins in WHEELS.values() if w in found and not found[w].startswith(begins)]
    if absent or other:
        wrong = f"{', '.join(other)}: not of {DISTRIBUTION}" if other else f"{', '.join(absent)}: not installed"
        raise ConfigError(f"ROS 2 wheels that do not go together: {wrong}: {INSTALL}")
    return DISTRIBUTION
