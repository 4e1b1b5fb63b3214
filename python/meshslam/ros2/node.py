"""The node: subscriptions, what they feed, services, and what it says of what it waits for."""

from __future__ import annotations

import contextlib
import queue
import re
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.errors import MapError, MeshslamError
from meshslam.geometry import Bytes, Pose
from meshslam.live import LivePose
from meshslam.maps import Map, TiledMap
from meshslam.ros2.conventions import covariance_of_body, twist_in_child
from meshslam.ros2.inlets import Inlets
from meshslam.ros2.live_types import LiveEstimator, OnPose
from meshslam.ros2.options import NodeOptions
from meshslam.ros2.outlets import Outlets
from meshslam.ros2.saving import LivePath, Saving, result_of
from meshslam.ros2.waiting import Waiting
from meshslam.sequences import CameraFile, ImuSamples

MakeLive = Callable[[CameraFile, Map | TiledMap | None, OnPose], LiveEstimator]
_KEPT_IMU_S, _EARLY_SAMPLES = 2.0, 2000  # of samples from before the estimation was made
_TICK_S, _DIAGNOSTICS_S = 0.25, 1.0
_NOTE_AGAIN_S = 5.0
_NUMBERS = re.compile(r"[-+]?\d+(\.\d+)?")
_STAMPS = 512  # of frames that are under way


class SlamNode:
    """Feeds `LiveEstimator`s that `make_live` makes, of a camera and of a known map or None, and publishes.

    Messages are taken in the thread that spins, and never wait for the estimation. What takes longer is done in a
    thread of the node's own, `_keep`: making the estimation, services, meshes, diagnostics, complaints. (Between the
    threads of a MultiThreadedExecutor the interpreter's lock changes hands so often that an IMU of 100 Hz is too fast.)
    """

    def __init__(
        self,
        node: Any,  # noqa: ANN401 # rclpy's
        options: NodeOptions,
        make_live: MakeLive,
        saving: Saving,
        *,
        camera: CameraFile | None,
        imu_from_camera: tuple[Pose, float] | None,
        camera_from_body: Pose | None,
    ) -> None:
        """`camera` is known from a file, or None; `imu_from_camera` with seconds by which the IMU's clock is ahead."""
        self._node, self._options, self._make_live, self._saving = node, options, make_live, saving
        self._imu_from_camera = None if imu_from_camera is None else imu_from_camera[0]
        ahead_s = 0.0 if imu_from_camera is None else imu_from_camera[1]
        self._camera_from_body = camera_from_body
        self._log = node.get_logger()
        self._live: LiveEstimator | None = None
        self._lock = threading.Lock()  # of what follows
        self._known: Map | TiledMap | None = None  # to localize in
        self._map_is_wanted = options.map  # a map's file that is still to be read
        self._early_imu: deque[ImuSamples] = deque(maxlen=_EARLY_SAMPLES)
        self._frame_number = 0
        self._stamps: dict[int, int] = {}
        self._rate: np.ndarray = np.zeros(3)
        self._newest_pose: LivePose | None = None
        self._notes: deque[str] = deque(maxlen=5)
        self._noted_s: dict[str, float] = {}
        self._live_error = ""
        self._map, self._mapped_frame = Map(()), -1  # as last looked at
        self.path = LivePath()
        self.fault: BaseException | None = None  # of the housekeeping
        self._outlets = Outlets(node, options, self._log.warning)
        self.inlets = Inlets(node, options, camera, ahead_s, self._take_samples, self._take_image)
        self._waiting = Waiting(options.patience_s, self.inlets.publishers, self._log)
        self._jobs: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._serve()
        self._keeper = threading.Thread(target=self._keep, name="housekeeping", daemon=True)
        self._keeper.start()

    # what comes in

    def _keep(self) -> None:
        """Jobs as they come, and what is due, by a steady clock: the node's own may stand still."""
        due = {
            self._tick: (_TICK_S, 0.0),
            self._show_objects: (self._options.objects_period_s, 0.0),
            self._outlets.path: (self._options.path_period_s, 0.0),
            self._diagnose: (_DIAGNOSTICS_S, 0.0),
        }
        try:
            while True:
                with contextlib.suppress(queue.Empty):
                    job = self._jobs.get(timeout=_TICK_S / 2)
                    if job is None:
                        return
                    job()
                for call, (period_s, last_s) in due.items():
                    if time.monotonic() - last_s >= period_s:
                        due[call] = (period_s, time.monotonic())
                        call()
        except BaseException as error:  # is raised where the node is spun
            self.fault = error

    def _take_samples(self, sample: ImuSamples) -> None:
        self._rate = sample.angular_rate_rad_s[0]
        with self._lock:
            if self._live is not None:
                self._given(lambda live: live.add_imu(sample))
                return
            self._early_imu.append(sample)
            while sample.times_s[0] - self._early_imu[0].times_s[0] > _KEPT_IMU_S:
                self._early_imu.popleft()

    def _take_image(self, image: Bytes, stamp: int) -> None:
        with self._lock:
            if self._live is None:
                return
            number = self._frame_number
            self._stamps[number] = stamp
            if len(self._stamps) > _STAMPS:
                self._stamps.pop(next(iter(self._stamps)))
            self._given(lambda live: live.add_frame(image, stamp / 1e9, number))
            self._frame_number += 1

    def _given(self, give: Callable[[LiveEstimator], None]) -> None:
        """Give something to the estimation; that it has stopped is said, not raised."""
        assert self._live is not None
        try:
            give(self._live)
        except MeshslamError as error:
            self._live_error = str(error)

    # what goes out

    def _on_pose(self, pose: LivePose) -> None:
        self._newest_pose = pose
        for note in pose.notes:
            self._note(note)
        if pose.world_from_camera is None:
            return
        stamp = self._stamps.get(pose.frame, round(pose.time_s * 1e6) * 1000)
        world_from_child, covariance, child = (
            pose.world_from_camera,
            pose.covariance,
            self.inlets.images.frame or "camera",
        )
        if self._camera_from_body is not None:
            world_from_child = pose.world_from_camera @ self._camera_from_body
            covariance = None if covariance is None else covariance_of_body(covariance, self._camera_from_body)
            child = self._options.body_frame
        self.path.add(pose.time_s, pose.world_from_camera)
        self._outlets.pose(stamp, child, world_from_child, pose.map_from_odometry, covariance, self._twist(pose))

    def _note(self, note: str) -> None:
        """Say what the estimation says, every 5 s at most where only numbers differ."""
        self._notes.append(note)
        about, now_s = _NUMBERS.sub("", note), time.monotonic()
        if now_s - self._noted_s.get(about, -_NOTE_AGAIN_S) >= _NOTE_AGAIN_S:
            self._noted_s[about] = now_s
            self._log.warning(note)

    def _twist(self, pose: LivePose) -> tuple[np.ndarray, np.ndarray] | None:
        if pose.velocity_in_world is None or pose.world_from_camera is None:
            return None
        imu_from_camera = self._imu_from_camera or Pose.identity()
        world_from_imu = pose.world_from_camera @ imu_from_camera.inverse()
        to_child = imu_from_camera if self._camera_from_body is None else imu_from_camera @ self._camera_from_body
        return twist_in_child(world_from_imu, pose.velocity_in_world, self._rate, to_child)

    def _show_objects(self) -> None:
        live, pose = self._live, self._newest_pose
        if live is None or pose is None or pose.world_from_camera is None:
            return
        if pose.frame != self._mapped_frame:
            try:
                self._map = live.map()
            except MeshslamError as error:
                self._note(f"no map: {error}")
                return
        self._mapped_frame = pose.frame
        self._outlets.objects(self._map)

    # estimation: made when the camera is known, made anew by services

    def _tick(self) -> None:
        if self._live is None and self.inlets.camera is not None and not self._live_error:
            self._begin()
        self._waiting.look(self.inlets.states, self._clock_problem(), self._estimation_problem())

    def _begin(self) -> None:
        """Make the estimation; what cannot be made is said, and tried again by ~/reset."""
        camera = self.inlets.camera
        assert camera is not None
        try:
            if self._map_is_wanted:
                self._known, self._map_is_wanted = Map.open(Path(self._map_is_wanted)), ""
            live = self._make_live(camera, self._known, self._on_pose)
            self._saving.camera(camera, self._imu_from_camera, self._options.height_above_ground_m or None)
        except MeshslamError as error:
            self._live_error = str(error)
            return
        with self._lock:
            self._live = live
            for sample in self._early_imu:
                live.add_imu(sample)
            self._early_imu.clear()
        what = "SLAM" if self._known is None else f"localization in a map of {len(self._known)} objects"
        self._log.info(f"{what}: waits for the first seconds")

    def _end_live(self) -> None:
        with self._lock:
            live, self._live = self._live, None
            self._early_imu.clear()
            self._stamps.clear()
        if live is not None:
            live.close()
        self._frame_number = 0
        self._newest_pose, self._live_error = None, ""
        self._map, self._mapped_frame = Map(()), -1
        self.inlets.begin_anew()
        self._notes.clear()
        self._noted_s.clear()
        self.path.forget()
        self._outlets.begin_anew()

    def _serve(self) -> None:
        from std_srvs.srv import SetBool, Trigger

        for kind, name, call in (
            (Trigger, "~/save_map", self._answer_save),
            (Trigger, "~/reset", self._answer_reset),
            (SetBool, "~/localize", self._answer_localize),
        ):
            self._node.create_service(kind, name, call)

    async def _answer(self, response: Any, act: Callable[[], str]) -> Any:  # noqa: ANN401 # ROS'
        """Let the housekeeping act, and answer when it has."""
        from rclpy.task import Future

        done = Future()

        def job() -> None:
            try:
                done.set_result((True, act()))
            except MeshslamError as error:
                done.set_result((False, str(error)))

        self._jobs.put(job)
        response.success, response.message = await done
        if response.success:
            self._log.info(response.message)
        else:  # a line of its own: rclpy's logger refuses another severity from the same line
            self._log.error(response.message)
        return response

    async def _answer_save(self, _request: Any, response: Any) -> Any:  # noqa: ANN401 # ROS'
        return await self._answer(response, self.save)

    async def _answer_reset(self, _request: Any, response: Any) -> Any:  # noqa: ANN401 # ROS'
        def act() -> str:
            self._end_live()
            return "begins anew; what was saved before stays until the next save"

        return await self._answer(response, act)

    async def _answer_localize(self, request: Any, response: Any) -> Any:  # noqa: ANN401 # ROS'
        return await self._answer(response, self._localize if request.data else self._slam)

    def _localize(self) -> str:
        """In the map of the parameter `map`, else in the one that SLAM has made."""
        if not self._options.imu:
            raise MapError("localizing needs an IMU: start the node with --imu and --imu-from-camera")
        chosen = str(self._node.get_parameter("map").value or "")
        known = Map.open(Path(chosen)) if chosen else None if self._live is None else self._live.map()
        if not known:
            raise MapError("there is no object to localize with: set the parameter map to a run, or go on with SLAM")
        self._end_live()
        self._known, self._map_is_wanted = known, ""
        return f"localizes in a map of {len(known)} objects"

    def _slam(self) -> str:
        self._end_live()
        self._known, self._map_is_wanted = None, ""
        return "SLAM begins anew"

    # saving

    def save(self) -> str:
        """Save map and path as they are; what was saved. MapError where there is nothing yet."""
        live, path = self._live, self.path.trajectory()
        if live is None or not len(path):
            raise MapError("nothing to save: no frame has a pose yet")
        found = live.map() if self._known is None else None
        self._saving.save(found, path)
        objects = "" if found is None else f"{len(found)} objects and "
        return f"saved: {objects}{len(path)} poses in {self._options.out}"

    def finish(self) -> str:
        """Smooth everything, fit the meshes once more, and save that."""
        if self._live is None or self._known is not None or not self._frame_number:
            return ""
        result = result_of(self._live)
        if result is None:
            return ""
        self._saving.save(result.map, result.trajectory, result)
        return f"saved, smoothed: {len(result.map)} objects and {len(result.trajectory)} poses in {self._options.out}"

    def stop(self) -> None:
        """End the housekeeping, and publish nothing more."""
        self._jobs.put(None)
        self._keeper.join()
        self._outlets.close()

    def close(self) -> None:
        """End the estimation's threads."""
        live, self._live = self._live, None
        if live is not None:
            live.close()

    # what it says of itself

    def _clock_problem(self) -> str:
        is_simulated = bool(self._node.get_parameter("use_sim_time").value)
        if is_simulated and self._node.get_clock().now().nanoseconds == 0:
            return "use_sim_time is set, and nothing has come on /clock"
        return ""

    def _estimation_problem(self) -> str:
        if self._live_error:
            return f"{self._live_error}: call ~/reset to try again"
        if self._live is None:
            return ""
        if self._newest_pose is None:
            return ""
        if self._newest_pose.world_from_camera is None:
            said = f": {self._newest_pose.notes[-1]}" if self._newest_pose.notes else ""
            return f"no pose yet: the first seconds of images and motion are collected{said}"
        return ""

    def _diagnose(self) -> None:
        statuses: list[tuple[str, int, str, dict[str, object]]] = []
        name = self._node.get_fully_qualified_name().lstrip("/")
        now_s = time.monotonic()
        for state in self.inlets.states:
            problem = self._waiting.problem(state, now_s)
            values = {
                "topic": state.topic,
                "received": state.received,
                "refused": state.refused,
                "late": state.late,
                "lost": state.lost,
                "last_refusal": state.why,
            }
            statuses.append((f"{name}: {state.name}", 2 if problem else 0, problem or "comes", values))
        problem = self._clock_problem() or self._estimation_problem()
        pose = self._newest_pose
        values = {
            "mode": "slam" if self._known is None else "localization",
            "objects": len(self._map),
            "poses": len(self.path),
            "latency_s": "" if pose is None else f"{pose.latency_s:.3f}",
            "by": "" if pose is None else pose.by,
            "last_note": self._notes[-1] if self._notes else "",
            **_counts_of(self._live),
        }
        level = 2 if self._live_error else 1 if problem else 0
        is_going = pose is not None and pose.world_from_camera is not None
        said = problem or ("poses are published" if is_going else "waits for input")
        statuses.append((f"{name}: estimation", level, said, values))
        self._outlets.diagnostics(self._node.get_clock().now().nanoseconds, statuses)


def _counts_of(live: LiveEstimator | None) -> dict[str, object]:
    counts = None if live is None else live.counts
    if not is_dataclass(counts) or isinstance(counts, type):
        return {}
    numbers = {one.name: getattr(counts, one.name) for one in fields(counts)}
    return {name: round(value, 3) for name, value in numbers.items() if isinstance(value, int | float)}
