"""These tests run in the environment that has the extra `ros2` (`make test` makes it); elsewhere they are skipped."""

import importlib.util
import os
import warnings

import numpy as np
import pytest

os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"  # before any message class is imported

if importlib.util.find_spec("rclpy") is None:
    collect_ignore_glob = ["test_messages.py", "test_node*.py", "test_inputs.py", "test_running.py"]
else:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # the wheels' parser imports what Python deprecates
        import rosidl_generator_py  # noqa: F401


@pytest.fixture
def car():
    from meshslam.categories import load_category
    from meshslam.geometry import Pose
    from meshslam.maps import MapObject

    known = load_category("car")
    sigmas = np.linspace(0.01, 0.3, len(known.vertices))
    place = Pose.from_yaw(0.7, np.array([12.0, -3.0, 0.8]))
    return MapObject(7, "car", place, known.vertices, known.faces, vertex_sigma_m=sigmas)
