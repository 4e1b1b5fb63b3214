"""A video file, with the camera by --camera FILE; frames are decoded when they are asked for."""

from __future__ import annotations

from collections.abc import Iterator
from collections.abc import Sequence as Items
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from meshslam.errors import SequenceError
from meshslam.files import digest_of_file
from meshslam.geometry import Bytes
from meshslam.sequences.cameras.read import read_camera
from meshslam.sequences.images import MAX_PIXELS
from meshslam.sequences.loader import LoadOptions
from meshslam.sequences.report import Report, fail
from meshslam.sequences.sequence import Sequence
from meshslam.sequences.time_files import read_frame_times

SUFFIXES = (".mp4", ".m4v", ".mov", ".avi", ".mkv", ".webm")
_AHEAD = 60  # frames that are decoded one after the other rather than looked for


@dataclass(frozen=True)
class Video:
    """Times are the frames' own, uneven or not, or those of --times FILE; turned as the file says."""

    name: str = "video"
    looks_for: str = "a file .mp4, .mov, .avi, .mkv or .webm"
    accepts: frozenset[str] = frozenset({"camera_file", "size", "times_file"})

    def recognizes(self, path: Path) -> bool:
        """By the file's first bytes."""
        if not path.is_file() or path.suffix.lower() not in SUFFIXES:
            return False
        with path.open("rb") as file:
            head = file.read(12)
        return head[4:8] in (b"ftyp", b"moov", b"mdat", b"wide", b"free") or head[:4] in (b"RIFF", b"\x1aE\xdf\xa3")

    def image_files(self, path: Path, options: LoadOptions) -> list[Path]:
        """None: the images are in the video."""
        return []

    def load(self, path: Path, options: LoadOptions, report: Report) -> Sequence:
        """Index the frames' times, decode the first; see Loader."""
        if path.is_dir():
            raise fail(path, "", f"is a folder, expected a video's file, {', '.join(SUFFIXES)}")
        if options.camera_file is None:
            raise fail(path, "", "a video says nothing of its camera: give --camera FILE (docs/cameras.md)")
        stamps, second = _index(path)
        if len(stamps) < 1:
            raise fail(path, "", "holds no frames: is it cut?")
        images = VideoImages(path, tuple(stamps))
        height, width = images.read(0, None).shape[:2]
        turn = images.turn_deg
        if turn:
            report.note(path, "", f"frames are turned by {turn}° as the video says: the camera is of {width}x{height}")
        found = read_camera(options.camera_file, options.camera_number, options.size or (width, height), report)
        times_s = np.array(stamps) * second
        if options.times_file is not None:
            times_s = read_frame_times(options.times_file, len(stamps), path, report)
        return Sequence(
            name=path.stem,
            layout=self.name,
            root=path,
            camera=found.camera,
            frame_ids=tuple(range(len(stamps))),
            times_s=times_s,
            images=images,
            detections_path=options.detections_path,
            imu_from_camera=found.imu_from_camera,
            height_above_ground_m=found.height_above_ground_m,
            distortion=found.distortion,
        )


@dataclass(eq=False)
class VideoImages:
    """The frames of a video at these stamps, in the video's units; best read one after the other."""

    path: Path
    stamps: tuple[int, ...]
    turn_deg: int = 0  # by which the last frame was turned, counter-clockwise
    _frames: Iterator[Any] | None = field(default=None, repr=False)
    _next: int = 0  # the frame that decoding has come to
    _lock: Lock = field(default_factory=Lock, repr=False)  # one decoder for all threads

    @property
    def names(self) -> tuple[str, ...]:
        """Numbers, as if the frames were files."""
        return tuple(f"{i:06d}.png" for i in range(len(self.stamps)))

    def __len__(self) -> int:
        return len(self.stamps)

    def __getstate__(self) -> dict[str, Any]:
        """For copies and pickles: decoding begins anew there."""
        kept = {name: value for name, value in vars(self).items() if name != "_lock"}
        return kept | {"_frames": None, "_next": 0}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """The reverse of `__getstate__`."""
        vars(self).update(state, _lock=Lock())

    def read(self, index: int, size: tuple[int, int] | None) -> Bytes:
        """See ImageSource."""
        with self._lock:
            frame = self._decoded(index)
        if frame.width * frame.height > MAX_PIXELS:
            raise SequenceError(f"{self.path}: frames of {frame.width}x{frame.height} pixels are not read")
        image = np.asarray(frame.to_ndarray(format="bgr24"), np.uint8)
        self.turn_deg = round(getattr(frame, "rotation", 0) / 90) * 90
        image = np.ascontiguousarray(np.rot90(image, self.turn_deg // 90))
        height, width = image.shape[:2]
        if size is not None and (width, height) != size:
            what = f"frame {index} is {width}x{height}, but the camera's resolution is {size[0]}x{size[1]}"
            raise SequenceError(f"{self.path}: {what}")
        return image

    def digests(self) -> tuple[str, ...]:
        """Of the file and the frames' stamps."""
        whole = digest_of_file(self.path) if self.path.is_file() else "missing"
        return tuple(f"{whole}:{stamp}" for stamp in self.stamps)

    def part(self, indices: Items[int]) -> VideoImages:
        """See ImageSource."""
        return VideoImages(self.path, tuple(self.stamps[i] for i in indices))

    def _decoded(self, index: int) -> Any:  # noqa: ANN401 # PyAV's frame
        av = import_av()
        wanted = self.stamps[index]
        try:
            if self._frames is None or not self._next <= index < self._next + _AHEAD:
                self._frames = _decoder(self.path, wanted)
            for frame in self._frames:
                if frame.pts is not None and frame.pts >= wanted:
                    self._next = index + 1
                    if frame.pts == wanted:
                        return frame
                    break
        except (av.error.FFmpegError, OSError, ValueError) as error:
            self._frames = None
            raise SequenceError(f"{self.path}: frame {index} cannot be decoded: {_said(error)}") from None
        self._frames = None
        raise SequenceError(f"{self.path}: frame {index} cannot be decoded: the video is damaged or cut there")


def import_av(where: str = "") -> Any:  # noqa: ANN401 # the extra's module
    """PyAV, silent; SequenceError, which begins with `where`, if it is not installed."""
    try:
        import av
        import av.error
    except ImportError:
        raise SequenceError(f'{where}video needs PyAV: pip install "meshslam[video]"') from None
    av.logging.set_level(None)
    return av


def _index(path: Path) -> tuple[list[int], float]:
    """The stamps of all frames in order, from their packets, and the unit of stamps in seconds."""
    av = import_av()
    try:
        with av.open(str(path)) as container:
            if not container.streams.video:
                raise fail(path, "", "holds no video")
            stream = container.streams.video[0]
            packets = container.demux(stream)
            stamps = {p.pts for p in packets if p.pts is not None and p.size and not p.is_discard}
            return sorted(stamps), float(stream.time_base)
    except (av.error.FFmpegError, OSError, ValueError) as error:
        raise fail(path, "", f"cannot be read as a video: {_said(error)}: is it cut?") from None


def _decoder(path: Path, stamp: int) -> Iterator[Any]:
    """Frames from the key frame before a stamp on."""
    with import_av().open(str(path)) as container:
        stream = container.streams.video[0]
        container.seek(stamp, stream=stream, backward=True)
        yield from container.decode(stream)


def _said(error: Exception) -> str:
    return " ".join(str(error).split())[:100]
