"""Images of a topic of compressed video (foxglove.CompressedVideo): a frame a message, decoded from a key frame on."""

from __future__ import annotations

import re
from collections.abc import Sequence as Items
from dataclasses import dataclass, field
from threading import Lock
from typing import Any

import numpy as np

from meshslam.files import digest_of_file
from meshslam.geometry import Bytes
from meshslam.sequences.bags.decoding import decoded
from meshslam.sequences.bags.pixels import bytes_of
from meshslam.sequences.bags.store import Channel, Position, Store
from meshslam.sequences.images import MAX_PIXELS
from meshslam.sequences.report import Report, fail
from meshslam.sequences.video import import_av

_CODECS = {"h264": "h264", "h265": "hevc"}  # PyAV's names by the schema's
_START = re.compile(rb"\x00\x00\x01(.)", re.DOTALL)  # of a unit of Annex B, and its first byte
_IDR, _INTRA = 5, range(16, 24)  # units that begin anew: H.264, table 7-1; H.265, table 7-1
_AHEAD = 60  # frames that are decoded one after the other rather than from the next key frame


def is_key(form: str, data: bytes) -> bool:
    """Whether a message's picture needs none before it."""
    kinds = {unit[0] for unit in _START.findall(data)}
    if form == "h265":
        return any((kind >> 1 & 0x3F) in _INTRA for kind in kinds)
    return any(kind & 0x1F == _IDR for kind in kinds)


def is_read(form: str) -> bool:
    """Whether a format of compressed video is one of those that are decoded."""
    return form in _CODECS


@dataclass(eq=False)
class BagVideo:
    """Frames of one topic; see ImageSource. `positions` are all messages in their order, `chosen` the frames'."""

    store: Store
    channel: Channel
    form: str
    positions: tuple[Position, ...]
    keys: tuple[bool, ...]  # of all messages
    chosen: tuple[int, ...]
    numbers: tuple[int, ...]  # of the frames
    _decoder: Any = field(default=None, repr=False)
    _fed: int = 0  # the message that the decoder gets next
    _ready: dict[int, Any] = field(default_factory=dict, repr=False)  # frames that came early, by their message
    _lock: Lock = field(default_factory=Lock, repr=False)  # one decoder for all threads

    @property
    def names(self) -> tuple[str, ...]:
        """000012.png and so on, by the frames' numbers."""
        return tuple(f"{number:06d}.png" for number in self.numbers)

    def __len__(self) -> int:
        return len(self.chosen)

    def __getstate__(self) -> dict[str, Any]:
        """For copies and pickles: decoding begins anew there."""
        kept = {name: value for name, value in vars(self).items() if name != "_lock"}
        return kept | {"_decoder": None, "_fed": 0, "_ready": {}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """The reverse of `__getstate__`."""
        vars(self).update(state, _lock=Lock())

    def read(self, index: int, size: tuple[int, int] | None) -> Bytes:
        """See ImageSource."""
        path, where = self.store.path, f"{self.channel.topic}, frame {self.numbers[index]}"
        with self._lock:
            frame = self._decoded(self.chosen[index])
        if frame is None:
            raise fail(path, where, f"a picture of {self.form} is damaged, or one that it needs is missing")
        if frame.width * frame.height > MAX_PIXELS:
            raise fail(
                path, where, f"image of {frame.width}x{frame.height} pixels: more than {MAX_PIXELS} are not read"
            )
        if size is not None and (frame.width, frame.height) != size:
            expected = f"but the camera's resolution is {size[0]}x{size[1]}"
            raise fail(path, where, f"image is {frame.width}x{frame.height}, {expected}")
        return np.ascontiguousarray(frame.to_ndarray(format="bgr24"), np.uint8)

    def digests(self) -> tuple[str, ...]:
        """The files' and the message's place in them."""
        files = [digest_of_file(file) if file.is_file() else "missing" for file in self.store.files]
        places = [self.positions[message] for message in self.chosen]
        return tuple(f"{files[p.file]} {self.channel.topic} {p.record} {p.offset}" for p in places)

    def part(self, indices: Items[int]) -> BagVideo:
        """See ImageSource."""
        kept = list(indices)
        chosen, numbers = (tuple(values[i] for i in kept) for values in (self.chosen, self.numbers))
        return BagVideo(self.store, self.channel, self.form, self.positions, self.keys, chosen, numbers)

    def depth(self, report: Report) -> int | None:
        """Video has 8 bits."""
        return None

    def _decoded(self, message: int) -> Any:  # noqa: ANN401 # PyAV's frame
        """The picture of a message; None where it cannot be decoded."""
        if message in self._ready:
            return self._ready.pop(message)
        if self._decoder is None or not self._fed <= message < self._fed + _AHEAD:
            self._begin(max(i for i in range(message + 1) if self.keys[i]))
        while self._fed < len(self.positions):
            self._feed()
            for earlier in [number for number in self._ready if number < message]:
                del self._ready[earlier]
            if message in self._ready:
                return self._ready.pop(message)
            if self._fed > message + _AHEAD:
                break
        self._take(self._decoder.decode(None) if self._fed == len(self.positions) else [])
        self._decoder, found = None, self._ready.pop(message, None)
        return found

    def _begin(self, key: int) -> None:
        decoder = import_av(f"{self.store.path}: {self.channel.topic}: ").CodecContext.create(_CODECS[self.form], "r")
        decoder.thread_count = 1
        self._decoder, self._fed, self._ready = decoder, key, {}

    def _feed(self) -> None:
        """Hand the decoder one message, whose number is its time."""
        av, number = import_av(), self._fed
        self._fed += 1
        message = decoded(self.store.path, self.channel, self.store.read(self.positions[number]))
        packet = av.Packet(bytes_of(message.data))
        packet.pts = packet.dts = number
        try:
            self._take(self._decoder.decode(packet))
        except (av.error.FFmpegError, ValueError):
            return  # the pictures that need it are not decoded either, which `read` says

    def _take(self, frames: list[Any]) -> None:
        self._ready |= {frame.pts: frame for frame in frames if frame.pts is not None and not frame.is_corrupt}


def from_first_key(topic_name: str, keys: Items[bool], order: Items[int], store: Store, report: Report) -> list[int]:
    """Which of the messages `order` can be decoded, by their place in it: those from the first key frame on.

    The others are noted; FoundError where none is left.
    """
    first = next((i for i, key in enumerate(keys) if key), len(keys))
    kept = [place for place, message in enumerate(order) if message >= first]
    if not kept:
        raise fail(store.path, topic_name, "its video has no key frame, so that no picture can be decoded")
    if len(kept) < len(order):
        said = f"{len(order) - len(kept)} pictures before the first key frame cannot be decoded and are left out"
        report.note(store.path, topic_name, said)
    return kept
