"""What the node says while nothing comes."""

import pytest

from meshslam.ros2.inputs import InputState
from meshslam.ros2.waiting import Waiting

IMU, IMAGE = "sensor_msgs/msg/Imu", "sensor_msgs/msg/Image"


class Log:
    def __init__(self):
        self.warnings, self.infos = [], []

    def warning(self, text):
        self.warnings.append(text)

    def info(self, text):
        self.infos.append(text)


class Scene:
    """A clock that is moved by hand, and publishers by topic."""

    def __init__(self):
        self.now_s, self.there, self.log = 100.0, {}, Log()
        self.waiting = Waiting(3.0, lambda topic: self.there.get(topic, []), self.log, lambda: self.now_s)
        self.imu = InputState("IMU", "/imu")

    def pass_s(self, seconds, step_s=0.25, each=None):
        for _ in range(round(seconds / step_s)):
            self.now_s += step_s
            if each is not None:
                each()
            self.waiting.look([self.imu], "")


def test_nothing_is_said_before_the_patience_is_over_and_then_every_five_seconds():
    scene = Scene()
    scene.pass_s(3.0)
    assert scene.log.warnings == []
    scene.pass_s(20.0)
    assert len(scene.log.warnings) == 4
    assert "no IMU on /imu for" in scene.log.warnings[0]
    assert "nobody publishes it" in scene.log.warnings[0]


def test_another_type_is_named():
    scene = Scene()
    scene.there["/imu"] = [(IMAGE, "camera_driver")]
    scene.pass_s(4.0)
    assert f"it is {IMAGE} by camera_driver, expected {IMU}" in scene.log.warnings[0]


def test_a_publisher_without_messages_is_named():
    scene = Scene()
    scene.there["/imu"] = [(IMU, "imu_driver")]
    scene.pass_s(4.0)
    assert "imu_driver publishes, and no message arrives" in scene.log.warnings[0]


def test_an_incompatible_qos_is_said_until_something_comes():
    scene = Scene()
    scene.imu.problem = "a publisher's QoS does not go with ours (RELIABILITY): nothing comes from it"
    scene.pass_s(2.0)
    assert "RELIABILITY" in scene.log.warnings[0]
    scene.imu.came(scene.now_s)
    scene.pass_s(1.0)
    assert scene.waiting.problem(scene.imu, scene.now_s) == ""


def test_what_stops_is_said_and_what_comes_back_too():
    scene = Scene()
    scene.pass_s(6.0, each=lambda: scene.imu.came(scene.now_s))
    assert scene.log.warnings == []
    scene.pass_s(3.5)
    assert len(scene.log.warnings) == 1
    scene.pass_s(1.0, each=lambda: scene.imu.came(scene.now_s))
    assert scene.log.infos == ["IMU arrives again"]


def test_a_calibration_need_come_once_only():
    scene = Scene()
    scene.imu = InputState("camera info", "/camera/camera_info")
    scene.imu.came(scene.now_s)
    scene.imu.take(1, "camera")
    scene.pass_s(60.0)
    assert scene.log.warnings == []


@pytest.mark.parametrize("name", ["images", "IMU"])
def test_what_cannot_be_used_is_said(name):
    scene = Scene()
    scene.imu = InputState(name, "/topic")

    def wrong():
        scene.imu.came(scene.now_s)
        scene.imu.refuse("its header has no stamp")

    scene.pass_s(12.0, each=wrong)
    assert len(scene.log.warnings) == 3
    assert "cannot be used: its header has no stamp" in scene.log.warnings[0]
