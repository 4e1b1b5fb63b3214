"""What the node is told."""

import dataclasses

import pytest

from meshslam.errors import ConfigError
from meshslam.ros2 import NodeOptions, checked_option, option_docs


@pytest.mark.parametrize(
    ("image", "info"),
    [
        ("/camera/image_raw", "/camera/camera_info"),
        ("/a/b/image_rect", "/a/b/camera_info"),
        ("/camera/image_raw/compressed", "/camera/camera_info"),
        ("image", "camera_info"),
    ],
)
def test_the_calibration_is_looked_for_beside_the_images(image, info):
    assert NodeOptions(image=image).camera_info_topic == info
    assert NodeOptions(image=image, camera_info="/other").camera_info_topic == "/other"


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"image": ""}, "--image"),
        ({"imu": "/imu"}, "--imu-from-camera"),
        ({"map": "run"}, "needs an IMU"),
        ({"patience_s": 0.0}, "patience_s"),
        ({"objects_period_s": -1.0}, "objects_period_s"),
        ({"height_above_ground_m": -1.0}, "metres from 0"),
    ],
)
def test_what_does_not_go_together_is_an_error_with_the_way_out(wrong, said):
    with pytest.raises(ConfigError, match=said):
        NodeOptions(**wrong)


def test_parameters_are_of_the_options_type():
    assert checked_option("patience_s", 3) == 3.0
    assert checked_option("overwrite", True) is True
    for name, value in (
        ("overwrite", 3),
        ("overwrite", "yes"),
        ("image", 3),
        ("patience_s", "3"),
        ("patience_s", True),
    ):
        with pytest.raises(ConfigError, match=f"parameter {name} is"):
            checked_option(name, value)


def test_every_option_is_described():
    assert set(option_docs()) == {field.name for field in dataclasses.fields(NodeOptions)}
    assert all(len(doc) > 10 for _, doc in option_docs().values())
