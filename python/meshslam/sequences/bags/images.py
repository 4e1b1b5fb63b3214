"""A bag's images, read when they are asked for."""

from __future__ import annotations

from collections.abc import Sequence as Items
from dataclasses import dataclass

import numpy as np

from meshslam.files import digest_of_file
from meshslam.geometry import Bytes
from meshslam.sequences.bags.decoding import decoded
from meshslam.sequences.bags.pixels import bits_of, image_of
from meshslam.sequences.bags.store import Channel, Position, Store
from meshslam.sequences.report import Report

_SAMPLED_FRAMES = 5  # whose brightest pixel tells the depth


@dataclass(frozen=True, eq=False)
class BagImages:
    """Images of one topic, one a frame; see ImageSource."""

    store: Store
    channel: Channel
    positions: tuple[Position, ...]
    numbers: tuple[int, ...]  # of the frames
    bits: int | None = None  # of values of 16 bits

    @property
    def names(self) -> tuple[str, ...]:
        """000012.png and so on, by the frames' numbers."""
        return tuple(f"{number:06d}.png" for number in self.numbers)

    def __len__(self) -> int:
        return len(self.positions)

    def read(self, index: int, size: tuple[int, int] | None) -> Bytes:
        """See ImageSource."""
        message = decoded(self.store.path, self.channel, self.store.read(self.positions[index]))
        return image_of(self.store.path, self._where(index), message, size, self.bits)

    def digests(self) -> tuple[str, ...]:
        """The files' and the message's place in them."""
        files = [digest_of_file(file) if file.is_file() else "missing" for file in self.store.files]
        return tuple(f"{files[p.file]} {self.channel.topic} {p.record} {p.offset}" for p in self.positions)

    def part(self, indices: Items[int]) -> BagImages:
        """See ImageSource."""
        kept = list(indices)
        positions, numbers = (tuple(values[i] for i in kept) for values in (self.positions, self.numbers))
        return BagImages(self.store, self.channel, positions, numbers, self.bits)  # type: ignore[arg-type]

    def depth(self, report: Report) -> int | None:
        """Bits of raw images that have 16 a channel, from a few frames, noted; None elsewhere."""
        chosen = np.unique(np.linspace(0, len(self) - 1, _SAMPLED_FRAMES).astype(int)).tolist()
        found = [bits for i in chosen if (bits := self._bits(i)) is not None]
        if not found:
            return None
        what = f"images of 16 bits a channel whose values have {max(found)} bits: scaled to 8"
        report.note(self.store.path, self.channel.topic, what)
        return max(found)

    def _bits(self, index: int) -> int | None:
        message = decoded(self.store.path, self.channel, self.store.read(self.positions[index]))
        return bits_of(self.store.path, self._where(index), message)

    def _where(self, index: int) -> str:
        return f"{self.channel.topic}, frame {self.numbers[index]}"
