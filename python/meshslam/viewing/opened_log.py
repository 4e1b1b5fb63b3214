"""Opens the logs of a run: what is wrong with them is said before the run computes."""

from __future__ import annotations

import contextlib
import queue
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from meshslam.errors import ConfigError
from meshslam.geometry import Camera, Floats, Pose
from meshslam.maps import Map, MapObject
from meshslam.perception import Detection
from meshslam.viewing.mcap_log import McapLog, can_write_mcap
from meshslam.viewing.rerun_log import RerunLog, can_record, has_display
from meshslam.viewing.run_log import Colouring, LoggedImage, RunLog

WAITING = 32  # what a run may be ahead of its logs: each holds at most an image
_CLOSE = None


@dataclass(frozen=True)
class LogTargets:
    """Where a run is logged to; see `open_run_log`."""

    view: bool = False  # the Rerun viewer, in a window of its own
    serve: bool = False  # the Rerun viewer as a page, served by this process on this machine
    rrd: Path | None = None  # a recording for the Rerun viewer
    mcap: Path | None = None  # a recording with Foxglove's schemas
    colouring: Colouring = "id"  # of meshes: by their ids, or by the sigma of their vertices

    @property
    def is_any(self) -> bool:
        """Whether there is one."""
        return self.view or self.serve or self.rrd is not None or self.mcap is not None

    def check(self, *, overwrite: bool = False) -> None:
        """ConfigError for what cannot be opened: no display, a missing package, a missing folder, a file in the way."""
        if self.view and self.serve:
            raise ConfigError("--view and --serve: give one: a window on this machine, or a page that browsers open")
        for flag, wanted in (("--view", self.view), ("--serve", self.serve), ("--rrd", self.rrd is not None)):
            if wanted and not can_record():
                raise ConfigError(f"{flag} needs the Rerun SDK, which is not installed: pip install 'meshslam[rerun]'")
        if self.mcap is not None and not can_write_mcap():
            raise ConfigError("--mcap needs packages that are not installed: pip install 'meshslam[foxglove]'")
        if self.view and not has_display():
            raise ConfigError(
                "--view: there is no display (DISPLAY and WAYLAND_DISPLAY are not set): give --serve and open the page "
                "in a browser, or keep the run with --rrd FILE"
            )
        for flag, file in (("--rrd", self.rrd), ("--mcap", self.mcap)):
            if file is not None:
                _check_file(flag, file, overwrite)


def _check_file(flag: str, file: Path, overwrite: bool) -> None:
    suffix = flag.removeprefix("--")
    if file.suffix.lower() != f".{suffix}":
        raise ConfigError(f"{flag} {file}: viewers know the file by its name: let it end with .{suffix}")
    if not file.parent.is_dir():
        raise ConfigError(f"{flag} {file}: there is no folder {file.parent}: make it, or choose another file")
    if file.is_dir():
        raise ConfigError(f"{flag} {file}: is a folder, expected a file to write")
    if file.exists() and not overwrite:
        raise ConfigError(f"{flag} {file}: the file is there: choose another, or give --overwrite to replace it")
    is_new = not file.exists()
    try:
        file.open("ab").close()  # a file that is there stays as it is until the run begins
        if is_new:
            file.unlink()
    except OSError as error:
        raise ConfigError(f"{flag} {file}: cannot be written: {error.strerror}") from None


class OpenedLog:
    """A `RunLog` that hands all on to several, in a thread of its own; any thread may use it.

    The run waits only where it is `WAITING` calls ahead. Ctrl-C never ends a write in the middle. Where a log fails,
    as on a full disk, `on_failure` is told once, nothing more is logged there, and the run goes on.
    """

    def __init__(self, logs: Sequence[tuple[str, RunLog]], on_failure: Callable[[str], None] | None = None) -> None:
        self.web_address = next((log.web_address for _, log in logs if isinstance(log, RerunLog)), None)
        self.colouring = logs[0][1].colouring
        self._logs, self._on_failure, self._failures = dict(logs), on_failure, list[str]()
        self._calls: queue.Queue[tuple[str, tuple[Any, ...]] | None] = queue.Queue(WAITING)
        self._lock, self._is_open = threading.Lock(), True
        self._thread = threading.Thread(target=self._work, name="run log", daemon=True)
        self._thread.start()

    def begin(self, title: str, camera: Camera) -> None:
        """As for `RunLog`."""
        self._call("begin", title, camera)

    def frame(
        self,
        number: int,
        time_s: float,
        world_from_camera: Pose | None = None,
        covariance: Floats | None = None,
        image: LoggedImage | None = None,
        detections: Sequence[Detection] = (),
        objects: Sequence[MapObject] | None = None,
        timings_ms: Mapping[str, float] | None = None,
    ) -> None:
        """As for `RunLog`; an image is copied, one that is read when it is needed is read in the log's thread."""
        kept = image if image is None or callable(image) else image.copy()
        objects = None if objects is None else tuple(objects)
        given = (number, time_s, world_from_camera, covariance, kept, tuple(detections), objects, timings_ms)
        self._call("frame", *given)

    def objects(self, objects: Sequence[MapObject]) -> None:
        """As for `RunLog`."""
        self._call("objects", tuple(objects))

    def result(
        self,
        scene: Map,
        frame_ids: Sequence[int],
        times_s: Floats,
        world_from_camera: Sequence[Pose],
        covariances: Floats | None = None,
        world_from_live: Pose | None = None,
    ) -> None:
        """As for `RunLog`."""
        self._call("result", scene, tuple(frame_ids), times_s, tuple(world_from_camera), covariances, world_from_live)

    def close(self) -> None:
        """As for `RunLog`: waits until all that was told is written."""
        with self._lock:
            was_open, self._is_open = self._is_open, False
        if was_open:
            self._calls.put(_CLOSE)
        self._thread.join()

    @property
    def failures(self) -> tuple[str, ...]:
        """What went wrong, a sentence for each log that failed."""
        return tuple(self._failures)

    def _call(self, method: str, *given: Any) -> None:  # noqa: ANN401 # what the method takes
        with self._lock:
            if not self._is_open:
                raise ConfigError("the log of the run is closed: nothing can be told to it")
            self._calls.put((method, given))

    def _work(self) -> None:
        while (call := self._calls.get()) is not _CLOSE:
            for target in list(self._logs):
                self._try(target, *call)
        for target in list(self._logs):
            self._try(target, "close", ())

    def _try(self, target: str, method: str, given: tuple[Any, ...]) -> None:
        log = self._logs[target]
        try:
            getattr(log, method)(*given)
        except Exception as error:  # whatever a viewer's library raises: the run is worth more than its log
            del self._logs[target]
            with contextlib.suppress(Exception):  # what it wrote may still become whole
                log.close()
            said = f"{target}: nothing more is logged, for the log failed: {' '.join(str(error).split())}"
            self._failures.append(said)
            if self._on_failure is not None:
                self._on_failure(said)


def open_run_log(
    targets: LogTargets, *, overwrite: bool = False, on_failure: Callable[[str], None] | None = None
) -> OpenedLog:
    """Open viewer and files for a run; ConfigError if one of them cannot be opened, the others are closed then.

    `overwrite` replaces files that are there. `on_failure` is told where a log fails later, see `OpenedLog`.

    Example:
        log = open_run_log(LogTargets(rrd=Path("run.rrd"), mcap=Path("run.mcap")))
        try:
            ...
        finally:
            log.close()

    """
    targets.check(overwrite=overwrite)
    logs: list[tuple[str, RunLog]] = []
    try:
        if targets.view or targets.serve or targets.rrd is not None:
            shown = RerunLog(targets.rrd, view=targets.view, serve=targets.serve, colouring=targets.colouring)
            logs.append(("Rerun" if targets.view or targets.serve else str(targets.rrd), shown))
        if targets.mcap is not None:
            logs.append((str(targets.mcap), McapLog(targets.mcap, colouring=targets.colouring)))
    except BaseException:
        for _, log in logs:
            log.close()
        raise
    return OpenedLog(logs, on_failure)
