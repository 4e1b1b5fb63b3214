"""The node against real drivers: processes of their own, over DDS on loopback, on KITTI's drive 06."""

import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from meshslam.geometry import Pose
from meshslam.maps import Map, Trajectory
from tests.ros2.harness import World

SHIFT_S = 1_700_000_000.0
AGAIN_S = 1000.0  # later, by the stamps, is the same drive once more
OFFLINE_END_ERROR_M = 0.77  # of `meshslam slam` on the same frames, the first pose laid on the true one
SOON = "expert: {estimation: {unknown_start: {settling_s: 1.0, alignment: {seconds: 1.5}}}}\n"


@pytest.fixture
def world(tmp_path):
    made = World(tmp_path)
    yield made
    made.close()


@pytest.fixture
def kitti(data_folder):
    return data_folder / "kitti_odometry"


@pytest.fixture
def told(kitti, data_folder, tmp_path):
    """Arguments of the node, and those of the publisher."""
    (tmp_path / "soon.yaml").write_text(SOON)
    mounting = kitti / "camera_from_imu.json"
    node = ["--imu", "/imu", "--imu-from-camera", mounting, "--height", 1.65, "--config", tmp_path / "soon.yaml"]
    node += ["--segmenter", data_folder / "models" / "yolov5n-seg.onnx", "--out", tmp_path / "run"]
    drivers = [kitti / "06", "--imu-file", kitti / "imu" / "06.csv", "--imu-from-camera", mounting, "--rate", 0.5]
    return node, drivers


def published_ns(world, name="publisher"):
    """Stamps of the images that were sent."""
    rows = [line.split() for line in world.said(name).splitlines() if line.startswith("image ")]
    return {round(float(time_s) * 1e9) for _, _, time_s in rows}


def true_poses(kitti):
    return np.loadtxt(kitti / "poses" / "06.txt").reshape(-1, 3, 4)


def end_error_m(kitti, frames, poses):
    """How far the last pose is from the true one, the first laid on it."""
    true = [Pose(row[:, :3], row[:, 3]) for row in true_poses(kitti)[frames]]
    moved, truly = poses[0].inverse() @ poses[-1], true[0].inverse() @ true[-1]
    return float(np.linalg.norm(moved.translation - truly.translation))


def frames_of(kitti, times_s):
    of_recording = np.loadtxt(kitti / "06" / "times.txt")
    return [int(np.abs(of_recording - (t - SHIFT_S) % AGAIN_S).argmin()) for t in times_s]


def call(world, *arguments):
    name = f"caller-{time.monotonic_ns()}"
    assert world.start(name, "tests.ros2.caller", *arguments).wait(timeout=60) == 0, world.said(name)
    return json.loads(world.said(name).splitlines()[-1])


def driven_again(world, drivers):
    """The map is saved after the whole drive, slower: on a busy machine the network saw too little for a start."""
    assert call(world, "reset")[0]
    slower = [*drivers, "--rate", 0.2, "--shift-s", SHIFT_S + AGAIN_S]
    assert world.publisher(*slower).wait(timeout=90) == 0
    done, said = call(world, "save_map")
    assert done, said


@pytest.mark.data
def test_a_drive_gives_odometry_a_path_and_a_map_and_services_answer(world, told, kitti, tmp_path):
    node_arguments, drivers = told
    node = world.node(*node_arguments)
    listener = world.listener()
    elsewhere = World(tmp_path / "elsewhere", domain=world.domain + 101)
    (tmp_path / "elsewhere").mkdir()
    try:
        stranger = elsewhere.node(*node_arguments[:-1], tmp_path / "other_run")
        assert world.publisher(*drivers).wait(timeout=60) == 0
        elsewhere.wait_for("node", "nobody publishes it")
        assert "camera:" not in elsewhere.said("node")
        assert elsewhere.end(stranger) == 0
    finally:
        elsewhere.close()

    if not call(world, "save_map")[0]:
        driven_again(world, drivers)
    scene = Map.load(tmp_path / "run")
    late = [world.listener(*flags, name=name) for name, flags in (("late", ()), ("volatile", ("--volatile",)))]
    for listening in late:
        for thing in scene.objects:
            world.wait_for(listening.name, f"car {thing.id}\n")
    seen = [world.heard(one)["objects"] for one in late]
    done, said = call(world, "localize", "true")
    assert (done, "localizes in a map of" in said) == (True, True) if scene else not done, said
    assert call(world, "reset")[0]
    done, said = call(world, "save_map")
    assert not done
    assert "nothing to save" in said

    heard = world.heard(listener)
    assert world.end(node) == 0
    assert "Traceback" not in world.said()
    assert "all deleted" in heard["log"]
    shown = {f"car {thing.id}": 3 * len(thing.faces) for thing in scene.objects}
    assert seen == [shown, shown]

    sent, odometry = published_ns(world), heard["odometry"]
    assert len(odometry) >= 5
    assert {row["ns"] for row in odometry} <= sent
    assert all(row["frames"] == ["odom", "camera_optical"] for row in odometry)
    covariances = np.array([row["covariance"] for row in odometry]).reshape(-1, 6, 6)
    assert (np.linalg.eigvalsh(covariances) > 0).all()
    turns = Rotation.from_quat([row["pose"][3:] for row in odometry]).as_matrix()
    poses = [Pose(turn, np.array(row["pose"][:3])) for turn, row in zip(turns, odometry, strict=True)]
    frames = frames_of(kitti, [row["ns"] / 1e9 for row in odometry])
    assert end_error_m(kitti, frames, poses) < 2 * OFFLINE_END_ERROR_M
    speeds = np.array([row["twist"][2] for row in odometry])  # the camera looks along its z
    assert (np.abs(speeds - 11.7) < 1.5).all()


@pytest.mark.data
def test_drivers_and_the_node_may_be_killed(world, told, kitti, tmp_path):
    node_arguments, drivers = told
    node = world.node(*node_arguments, "--ros-args", "-p", "patience_s:=1.0")
    listener = world.listener()
    first = world.publisher(*drivers, "--drop", 9, "--swap", 7, name="first")
    world.wait_for("first", "image 24 ")
    world.end(first, signal.SIGKILL)
    world.wait_for("node", "no images on /camera/image_raw for")
    second = world.publisher(*drivers, "--first", 28, "--reliable", "--late-s", 0.12, name="second")
    assert second.wait(timeout=60) == 0
    assert "images arrive again" in world.said()
    if not call(world, "save_map")[0]:
        driven_again(world, drivers)

    images = world.heard(listener)["diagnostics"]["meshslam: images"][2]
    assert int(images["late"]) > 0
    assert int(images["received"]) > 30

    world.end(node, signal.SIGKILL)
    saved = Trajectory.load(tmp_path / "run" / "trajectory.tum")
    Map.load(tmp_path / "run")
    frames = frames_of(kitti, saved.times_s)
    assert frames[-1] >= 47
    assert end_error_m(kitti, frames, saved.world_from_camera) < 3.0

    again = world.node(*node_arguments, name="again")
    assert again.wait(timeout=30) == 2
    assert "choose another --out, or --overwrite it" in world.said("again")
    over = world.node(*node_arguments, "--overwrite", name="over")
    world.wait_for("over", "nobody publishes it")
    assert world.end(over, signal.SIGINT) == 0
    np.testing.assert_array_equal(Trajectory.load(tmp_path / "run" / "trajectory.tum").times_s, saved.times_s)


def test_what_does_not_go_together_is_said(world, tmp_path):
    mounting = tmp_path / "mounting.json"
    mounting.write_text(json.dumps({"imu_from_camera": np.eye(4).tolist()}))
    parameters = tmp_path / "parameters.yaml"
    parameters.write_text(
        "meshslam:\n  ros__parameters:\n    patience_s: 0.5\n    imagee: /typo\n    segmenter: colour\n"
    )
    ros = ["--ros-args", "--params-file", parameters, "-r", "/imu:=/imu2", "-p", "use_sim_time:=true"]
    ros += ["-p", "qos_overrides./imu2.subscription.reliability:=reliable", "-p", "camera_info:=/info"]
    drivers = world.start("wrong", "tests.ros2.wrong_drivers")
    node = world.node("--imu", "/imu", "--imu-from-camera", mounting, "--out", tmp_path / "run", *ros)
    world.wait_for("node", "it is sensor_msgs/msg/Imu by wrong_drivers, expected sensor_msgs/msg/Image")
    world.wait_for("node", "/imu2: a publisher's QoS does not go with ours (RELIABILITY)")
    world.wait_for("node", "the camera is not calibrated: K is zero: give --camera FILE")
    world.wait_for("node", "use_sim_time is set, and nothing has come on /clock")
    world.wait_for("node", "parameter imagee: the node has none of this name")
    assert world.end(node) == 0
    assert world.end(drivers) in (0, -signal.SIGTERM)
    assert "Traceback" not in world.said()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--segmenter", "missing.onnx"], "missing.onnx"),
        (["--segmenter", "colour", "--camera", "missing.yaml"], "missing.yaml"),
        (["--segmenter", "colour", "--ros-args", "-p", "overwrite:=3"], "parameter overwrite is 3"),
        (["--segmenter", "colour", "--ros-args", "-r", "nonsense"], "ROS does not take this"),
    ],
)
def test_wrong_arguments_end_the_node_with_one_line(world, tmp_path, arguments, said):
    assert world.node("--out", tmp_path / "run", *arguments).wait(timeout=30) == 2
    lines = [line for line in world.said().splitlines() if line.startswith("error:")]
    assert len(lines) == 1
    assert said in lines[0]
    assert "Traceback" not in world.said()


def test_without_a_folder_for_logs_the_node_starts(world, tmp_path):
    blocked = tmp_path / "file"
    blocked.touch()
    world.environment["ROS_LOG_DIR"] = str(blocked / "log")
    node = world.node("--segmenter", "colour", "--out", tmp_path / "run")
    world.wait_for("node", "nobody publishes it")
    assert world.end(node) == 0


def test_other_programs_of_the_environment_start_as_ever(world):
    """The wheels start every python of their environment twice: what a child inherits must not stop that."""
    command = ["-c", "import rclpy; rclpy.init(); rclpy.create_node('one')"]
    assert subprocess.run([sys.executable, *command], env=world.environment, timeout=30, check=False).returncode == 0
