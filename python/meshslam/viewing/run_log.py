"""Where a run is logged as it computes: one protocol, whatever shows or keeps it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Literal, Protocol

from meshslam.geometry import Bytes, Camera, Floats, Pose
from meshslam.maps import Map, MapObject
from meshslam.perception import Detection

Colouring = Literal["id", "sigma"]
LoggedImage = Bytes | Callable[[], Bytes]  # BGR (h, w, 3), or what reads it when it is needed


class RunLog(Protocol):
    """What a run tells while it computes; `open_run_log` makes one for the Rerun viewer and for files.

    The world is z up. Lengths are in metres, times in seconds, images BGR (h, w, 3). A covariance (6, 6) is that of a
    right perturbation of world_from_camera, (translation, rotation), m and rad. `begin` comes first, `close` last.

    Example:
        log = open_run_log(LogTargets(rrd=Path("run.rrd")))
        log.begin("drive", camera)
        log.frame(0, 12.3, world_from_camera, image=image, detections=found, objects=slam.map().objects)
        log.close()

    """

    @property
    def colouring(self) -> Colouring:
        """What colours meshes: objects with their sigmas are wanted for `sigma` only."""

    def begin(self, title: str, camera: Camera) -> None:
        """Say which recording it is, and the camera of its images."""

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
        """What is known of a frame by now; a frame that is told again is replaced, but its image is kept.

        `detections` are in the colours of their tracks. `objects` are as for `objects`; None: they did not change.
        `timings_ms` is what the frame took, by stage.
        """

    def objects(self, objects: Sequence[MapObject]) -> None:
        """Every object that is known now: those that are not among them vanish."""

    def result(
        self,
        scene: Map,
        frame_ids: Sequence[int],
        times_s: Floats,
        world_from_camera: Sequence[Pose],
        covariances: Floats | None = None,
        world_from_live: Pose | None = None,
    ) -> None:
        """The map and the path that the run ends with, `covariances` (n, 6, 6): they show at all times.

        `world_from_live` takes what was told before into the world of the result, where that is another.
        """

    def close(self) -> None:
        """Finish what is kept; nothing can be told afterwards. A log may be closed again."""
