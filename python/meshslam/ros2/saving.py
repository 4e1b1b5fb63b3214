"""The node's run directory: saved again and again, whole each time."""

from __future__ import annotations

import contextlib
import threading
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from meshslam.errors import MapError
from meshslam.files import LOCK, locked
from meshslam.geometry import Pose
from meshslam.maps import Map, RunDirectory, Trajectory
from meshslam.object_slam import SlamResult
from meshslam.runs import Config, to_yaml
from meshslam.sequences import CameraFile, camera_yaml


class Saving:
    """A run directory that no other process writes meanwhile.

    Example:
        with Saving(Path("run"), Config(), "slam", overwrite=False) as saving:
            saving.save(slam.map(), slam.trajectory())

    """

    def __init__(self, out: Path, settings: Config, command: str, *, overwrite: bool) -> None:
        """MapError if the folder holds anything else, or a map and not `overwrite`, or another process has it."""
        self._out, self._settings, self._command, self._overwrite = out, settings, command, overwrite
        self._lock = threading.Lock()
        self._stack = contextlib.ExitStack()
        self._run: RunDirectory | None = None

    def __enter__(self) -> Saving:
        """Take the folder."""
        out = self._out
        RunDirectory.claim(out)
        self._stack.enter_context(locked(out / LOCK, str(out)))
        try:
            there = [name for name in ("map.json", "trajectory.tum") if (out / name).exists()]
            if there and not self._overwrite:
                raise MapError(f"{out}: {there[0]} is there already: choose another --out, or --overwrite it")
            config = to_yaml(self._settings, self._command)
            self._run = RunDirectory.start(out, config, version("meshslam"), overwrite=self._overwrite)
        except BaseException:
            self._stack.close()
            raise
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        """Let the folder go."""
        self._stack.close()

    def camera(self, camera: CameraFile, imu_from_camera: Pose | None, height_above_ground_m: float | None) -> None:
        """Write camera.yaml, of the pinhole view."""
        with self._lock:
            self._needed.save("camera.yaml", camera_yaml(camera.camera, None, imu_from_camera, height_above_ground_m))

    def save(self, found: Map | None, path: Trajectory, result: SlamResult | None = None) -> None:
        """Write map and path; MapError if the disk does not take them, and what was there stays.

        Without a map, as where one is known, the path alone; `result` is what smoothing gave.
        """
        with self._lock:
            run = self._needed
            if found is not None:
                run.save_map_again(found)
            run.save("trajectory.tum", path.to_tum())
            if result is not None and result.estimate is not None:
                run.save("trajectory.csv", result.estimate.to_csv())
            run.finish()

    @property
    def _needed(self) -> RunDirectory:
        if self._run is None:
            raise MapError(f"{self._out}: not taken yet")
        return self._run


class LivePath:
    """The camera's poses as they were published: time and pose, of all frames; safe between threads."""

    def __init__(self) -> None:
        """Begin without any."""
        self._rows: list[tuple[float, Pose]] = []
        self._lock = threading.Lock()

    def add(self, time_s: float, pose: Pose) -> None:
        """Add a pose; one that is not after the last is left out."""
        with self._lock:
            if not self._rows or time_s > self._rows[-1][0]:
                self._rows.append((time_s, pose))

    def forget(self) -> None:
        """Begin anew."""
        with self._lock:
            self._rows.clear()

    def trajectory(self) -> Trajectory:
        """All of it."""
        with self._lock:
            rows = list(self._rows)
        return Trajectory(np.array([t for t, _ in rows]), tuple(pose for _, pose in rows))

    def __len__(self) -> int:
        return len(self._rows)


def result_of(live: Any) -> SlamResult | None:  # noqa: ANN401 # SLAM's, or a localizer
    """What finishing gives, where it gives a result."""
    found = live.finish()
    return found if isinstance(found, SlamResult) else None
