"""The node's process: ROS is started, spun until a signal, and what was estimated is saved."""

from __future__ import annotations

import os
import signal
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

from meshslam.errors import ConfigError, MeshslamError, ModelError
from meshslam.files import must_exist
from meshslam.geometry import Pose
from meshslam.live import LiveSlam
from meshslam.localization import Localizer
from meshslam.maps import Map, TiledMap
from meshslam.object_slam import Slam, SlamLocalMapping, SlamParts
from meshslam.perception import COLOUR, find_model, renamings
from meshslam.ros2.live_types import LiveEstimator, OnPose
from meshslam.ros2.newest import NewestFrame
from meshslam.ros2.node import MakeLive, SlamNode
from meshslam.ros2.options import NodeOptions, checked_option, option_docs
from meshslam.ros2.saving import Saving
from meshslam.ros2.versions import check_ros2
from meshslam.runs import Config, overlaid, read_config
from meshslam.sequences import CameraFile, read_camera, read_camera_from_body, read_extrinsics

_SPIN_S = 0.1
Maker = Callable[[NodeOptions, Config, tuple[Pose, float] | None], MakeLive]


class Signals:
    """SIGTERM and Ctrl-C as a flag, from before ROS starts: with ROS' own handlers a process that computes lives on.

    The second one ends what is still under way.
    """

    def __init__(self) -> None:
        """No signal yet."""
        self.count = 0
        self.has_come = threading.Event()

    @contextmanager
    def caught(self) -> Iterator[Signals]:
        """For the block; the handlers before come back."""
        numbers = (signal.SIGTERM, signal.SIGINT)
        before = {number: signal.signal(number, self._take) for number in numbers}
        try:
            yield self
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _take(self, _number: int, _frame: FrameType | None) -> None:
        self.count += 1
        self.has_come.set()


def run_node(options: NodeOptions, ros_arguments: Sequence[str] = (), *, make: Maker | None = None) -> bool:
    """Run the node until SIGTERM or Ctrl-C, and save; whether everything was done, False if a second signal cut it.

    `options` are the defaults of the ROS parameters; `ros_arguments` begin with `--ros-args`. ConfigError for wheels,
    parameters or arguments that do not fit; SequenceError, MapError or ModelError for files that cannot be read; else
    what goes wrong is said in the node's log and diagnostics. `make` replaces the estimation.

    Example:
        run_node(NodeOptions(imu="/imu", imu_from_camera="mounting.yaml"), ["--ros-args", "-p", "use_sim_time:=true"])

    """
    check_ros2()
    _log_folder()
    import rclpy
    from rclpy.exceptions import InvalidParameterTypeException
    from rclpy.signals import SignalHandlerOptions

    with Signals().caught() as signals:
        try:
            rclpy.init(args=["meshslam", *ros_arguments], signal_handler_options=SignalHandlerOptions.NO)
        except Exception as error:
            raise ConfigError(f"{' '.join(ros_arguments)[:100]}: ROS does not take this: {_line(error)}") from None
        try:
            node = rclpy.create_node("meshslam", automatically_declare_parameters_from_overrides=True)
            return _run(node, parameters(node, options), signals, make or _estimation)
        except InvalidParameterTypeException as error:
            raise ConfigError(_line(error)) from None
        finally:
            rclpy.try_shutdown()


def parameters(node: Any, options: NodeOptions) -> NodeOptions:  # noqa: ANN401 # rclpy's
    """The options with the node's parameters over them, which are declared; ConfigError for a value of another type."""
    from rcl_interfaces.msg import ParameterDescriptor

    values: dict[str, Any] = {}
    for name, (_, doc) in option_docs().items():
        descriptor = ParameterDescriptor(description=doc, read_only=name != "map", dynamic_typing=True)
        if node.has_parameter(name):
            values[name] = checked_option(name, node.get_parameter(name).value)
            node.set_descriptor(name, descriptor)
        else:
            values[name] = node.declare_parameter(name, getattr(options, name), descriptor).value
    known = {one.name for one in fields(NodeOptions)} | {"use_sim_time", "start_type_description_service"}
    for name in sorted(node.get_parameters_by_prefix("")):
        if name not in known and not name.startswith("qos_overrides."):
            node.get_logger().warning(f"parameter {name}: the node has none of this name")
    return NodeOptions(**values)


def _run(node: Any, options: NodeOptions, signals: Signals, make: Maker) -> bool:  # noqa: ANN401 # rclpy's
    from rclpy.executors import SingleThreadedExecutor

    settings = settings_of(options)
    camera = None if not options.camera else read_camera(Path(options.camera))
    mounted = _mounting(options, camera)
    body = None if not options.camera_from_body else read_camera_from_body(Path(options.camera_from_body))
    if settings.input.segmenter != COLOUR:
        must_exist(find_model(settings.input.segmenter), "network", ModelError)  # said before anything else
    if options.map:
        Map.load(Path(options.map))
    with Saving(
        Path(options.out), settings, "localize" if options.map else "slam", overwrite=options.overwrite
    ) as saving:
        made = make(options, settings, mounted)
        slam_node = SlamNode(node, options, made, saving, camera=camera, imu_from_camera=mounted, camera_from_body=body)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        try:
            while not signals.has_come.is_set() and slam_node.fault is None:
                executor.spin_once(timeout_sec=_SPIN_S)
                slam_node.inlets.follow_images()
        finally:
            is_done = _end(node, slam_node, signals, executor, refine=options.refine)
        return is_done


def _end(node: Any, slam_node: SlamNode, signals: Signals, executor: Any, *, refine: bool) -> bool:  # noqa: ANN401 # rclpy's
    """Save what there is at once, then what smoothing gives; a second signal ends that."""
    log = node.get_logger()
    slam_node.stop()
    failed: list[BaseException] = []

    def work() -> None:
        for step in (slam_node.save, *((slam_node.finish,) if refine else ())):
            try:
                said = step()
            except MeshslamError as error:
                log.warning(str(error))
            except BaseException as error:  # it is raised again where the thread is waited for
                failed.append(error)
                return
            else:
                if said:
                    log.info(said)

    thread = threading.Thread(target=work, name="saving", daemon=True)
    first = signals.count
    thread.start()
    while thread.is_alive() and signals.count <= first:
        thread.join(timeout=0.1)
    if thread.is_alive():
        log.warning("a second signal: ended at once; what was saved is whole")
        return False
    slam_node.close()
    executor.shutdown(timeout_sec=2.0)
    node.destroy_node()
    for fault in (*failed, slam_node.fault):
        if fault is not None:
            raise fault
    return True


def settings_of(options: NodeOptions) -> Config:
    """The configuration that the options make; ConfigError as for a command's flags."""
    command = "localize" if options.map else "slam"
    settings = read_config(Path(options.config) if options.config else None, command)
    given = {
        "segmenter": options.segmenter,
        "adapter": options.adapter,
        "category_names": [pair.strip() for pair in options.classes.split(",") if pair.strip()],
        "imu_from_camera": options.imu_from_camera,
        "camera_file": options.camera,
        "map": options.map,
    }
    values: dict[str, object] = {key: value for key, value in given.items() if value}
    if options.category != "car":
        values["category"] = options.category
    return overlaid(settings, {"input": values, "keypoints": {"enabled": options.keypoints}}, "parameters")


def _mounting(options: NodeOptions, camera: CameraFile | None) -> tuple[Pose, float] | None:
    """imu_from_camera, and by how many seconds the IMU's clock is ahead."""
    if not options.imu:
        return None
    if options.imu_from_camera:
        seen = None if camera is None else camera.camera
        pose, ahead_s = read_extrinsics(Path(options.imu_from_camera), None, seen)
        return pose, ahead_s + options.imu_time_offset_s
    if camera is None or camera.imu_from_camera is None:
        raise ConfigError(f"{options.camera}: says nothing of how the IMU is mounted: give --imu-from-camera FILE")
    return camera.imu_from_camera, options.imu_time_offset_s


def _estimation(options: NodeOptions, settings: Config, mounted: tuple[Pose, float] | None) -> MakeLive:
    """SLAM, or localization in a known map."""
    common: dict[str, Any] = {
        "imu_from_camera": None if mounted is None else mounted[0],
        "segmenter": settings.input.segmenter,
        "adapter": settings.input.adapter,
        "classes": renamings(settings.input.category_names) or None,
        "config": settings,
        "source": "ros2",
    }

    def made(camera: CameraFile, known: Map | TiledMap | None, on_pose: OnPose) -> LiveEstimator:
        if known is not None:
            local = partial(SlamLocalMapping, config=SlamParts(estimation=settings.estimation))
            localizer = Localizer(camera.camera, known, **common, local_mapping=local)
            return NewestFrame(localizer, known, on_pose=on_pose, has_imu=True)
        height_m = options.height_above_ground_m or camera.height_above_ground_m
        common_of_slam = {**common, "category": settings.input.category, "height_above_ground_m": height_m}
        if mounted is None:
            return NewestFrame(Slam(camera.camera, **common_of_slam), None, on_pose=on_pose, has_imu=False)
        return LiveSlam(camera.camera, live=settings.live, on_pose=on_pose, **common_of_slam)

    return made


def _log_folder() -> None:
    """ROS cannot start where its folder of logs cannot be made: then they go to a temporary one."""
    chosen = os.environ.get("ROS_LOG_DIR", "")
    try:
        folder = Path(chosen or Path(os.environ.get("ROS_HOME", "") or "~/.ros") / "log").expanduser()
        folder.mkdir(parents=True, exist_ok=True)
        if not os.access(folder, os.W_OK):
            raise PermissionError
    except (OSError, RuntimeError):
        os.environ["ROS_LOG_DIR"] = tempfile.mkdtemp(prefix="meshslam-ros-log-")


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())[:200]
