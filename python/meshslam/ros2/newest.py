"""Estimation in a thread of its own that takes the newest frame: what comes while it works is skipped, and counted."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from meshslam.errors import MeshslamError
from meshslam.geometry import Bytes, Floats
from meshslam.live import LivePose
from meshslam.localization import Localizer
from meshslam.maps import Map, TiledMap
from meshslam.object_slam import Slam, SlamResult
from meshslam.sequences import ImuSamples

_SHOWN_M = 70.0  # around the camera, of a map in tiles
_LONGEST_WAIT_S = 0.25  # for samples that reach a frame's time


@dataclass
class NewestCounts:
    """Frames by what became of them."""

    frames: int = 0  # that came
    poses: int = 0  # that have a pose
    skipped: int = 0  # a newer one came before they were looked at
    refused: int = 0  # that could not be taken in


class NewestFrame:
    """Localization in a known map, or SLAM by images alone, fed by drivers: `add_imu` and `add_frame` never wait.

    Poses are handed to `on_pose` in the thread that estimates. With an IMU a frame waits for samples up to its time,
    0.25 s at most.

    Example:
        live = NewestFrame(localizer, known_map, on_pose=print, has_imu=True)
        live.add_imu(samples)
        live.add_frame(image, 12.3, 0)
        live.close()

    """

    def __init__(
        self,
        estimator: Localizer | Slam,
        known: Map | TiledMap | None,
        *,
        on_pose: Callable[[LivePose], None],
        has_imu: bool,
    ) -> None:
        """`known` is the map that a Localizer has; None for SLAM."""
        self._estimator, self._known, self._on_pose, self._has_imu = estimator, known, on_pose, has_imu
        self._estimate_lock = threading.Lock()
        self.counts = NewestCounts()
        self._changed = threading.Condition()
        self._samples: list[ImuSamples] = []
        self._newest_imu_s = -np.inf
        self._next: tuple[Bytes, float, int] | None = None
        self._is_busy = self._is_closed = False
        self._place: Floats | None = None  # of the newest pose
        self._thread = threading.Thread(target=self._run, name="localization", daemon=True)
        self._thread.start()

    def add_imu(self, samples: ImuSamples) -> None:
        """Take samples, from any thread."""
        with self._changed:
            self._samples.append(samples)
            if len(samples.times_s):
                self._newest_imu_s = max(self._newest_imu_s, float(samples.times_s.max()))
            self._changed.notify_all()

    def add_frame(self, image: Bytes, time_s: float, frame: int | None = None) -> None:
        """Take an undistorted image, BGR (h, w, 3), from any thread; one that waits still is skipped."""
        with self._changed:
            self.counts.frames += 1
            self.counts.skipped += self._next is not None
            self._next = (image, time_s, self.counts.frames - 1 if frame is None else frame)
            self._changed.notify_all()

    def map(self) -> Map:
        """The known map, or SLAM's as it is now: it waits for the frame that is being taken in.

        Of a map in tiles what is around the newest pose; nothing before there is one.
        """
        if isinstance(self._estimator, Slam):
            with self._estimate_lock:
                return self._estimator.map()
        if isinstance(self._known, TiledMap):
            place = self._place
            return Map(() if place is None else self._known.near(place, _SHOWN_M))
        return self._known or Map(())

    def finish(self) -> SlamResult | None:
        """Wait until the last frame is done; then SLAM's smoothed result. Localization has nothing to smooth."""
        with self._changed:
            self._changed.wait_for(lambda: self._is_closed or (self._next is None and not self._is_busy), timeout=10.0)
        if not isinstance(self._estimator, Slam):
            return None
        with self._estimate_lock:
            return self._estimator.finish()

    def close(self) -> None:
        """End the thread."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()
        if threading.current_thread() is not self._thread:
            self._thread.join()

    def _run(self) -> None:
        while (taken := self._taken()) is not None:
            told = self._estimated(*taken)
            self._place = self._place if told.world_from_camera is None else told.world_from_camera.translation
            self._on_pose(told)
            with self._changed:
                self._is_busy = False
                self._changed.notify_all()

    def _taken(self) -> tuple[Bytes, float, int, ImuSamples, float] | None:
        """The newest frame with the samples up to its time; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._next is not None or self._is_closed)
            if self._is_closed or self._next is None:
                return None
            began_s = time.monotonic()
            if self._has_imu:
                self._changed.wait_for(self._reaches_frame, timeout=_LONGEST_WAIT_S)
            if self._is_closed:
                return None
            (image, time_s, frame), self._next, self._is_busy = self._next, None, True
            every = [s for s in self._samples if len(s.times_s)]
            now = [s for s in every if float(s.times_s.min()) <= time_s]
            self._samples = [s for s in every if float(s.times_s.min()) > time_s]
            return image, time_s, frame, _joined(now), began_s

    def _reaches_frame(self) -> bool:
        return self._is_closed or (self._next is not None and self._newest_imu_s >= self._next[1])

    def _estimated(self, image: Bytes, time_s: float, frame: int, samples: ImuSamples, began_s: float) -> LivePose:
        given: dict[str, Any] = {"image": image, "time_s": time_s, "frame": frame}
        if self._has_imu:
            given["imu"] = samples
        try:
            with self._estimate_lock:
                state = self._estimator.process(**given)
        except MeshslamError as error:
            self.counts.refused += 1
            return LivePose(frame, time_s, None, None, None, time.monotonic() - began_s, "waiting", (), (str(error),))
        pose = state.world_from_camera
        self.counts.poses += pose is not None
        return LivePose(
            frame,
            time_s,
            pose,
            state.camera_covariance,
            state.velocity_in_world,
            time.monotonic() - began_s,
            "waiting" if pose is None else "window",
            state.objects,
            state.notes,
        )


def _joined(parts: list[ImuSamples]) -> ImuSamples:
    if not parts:
        return ImuSamples(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    times_s = np.concatenate([p.times_s for p in parts])
    rates = np.concatenate([p.angular_rate_rad_s for p in parts])
    forces = np.concatenate([p.specific_force_m_s2 for p in parts])
    return ImuSamples(times_s, rates, forces)
