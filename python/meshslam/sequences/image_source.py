"""Where the images of a recording come from: files, or one file that holds all of them."""

from __future__ import annotations

from collections.abc import Sequence as Items
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from meshslam.files import digest_of_file
from meshslam.geometry import Bytes
from meshslam.sequences.images import load_image


class ImageSource(Protocol):
    """The images of a recording as its camera took them, one a frame, counted from 0; read when they are asked for."""

    @property
    def names(self) -> tuple[str, ...]:
        """What each image is called, as detections may call it: a file's name, or one like 000012.png."""

    def __len__(self) -> int:
        """The number of images."""

    def read(self, index: int, size: tuple[int, int] | None) -> Bytes:
        """An image as BGR (h, w, 3); SequenceError if it is missing, damaged or not of `size` (w, h)."""

    def digests(self) -> tuple[str, ...]:
        """A text for each image that is another for other content."""

    def part(self, indices: Items[int]) -> ImageSource:
        """Some of the images, in this order."""


@dataclass(frozen=True)
class ImageFiles:
    """Images that are files of their own."""

    paths: tuple[Path, ...]
    bits: int | None = None  # of images of 16 bits a channel: how many their values have

    @property
    def names(self) -> tuple[str, ...]:
        """The files' names."""
        return tuple(path.name for path in self.paths)

    def __len__(self) -> int:
        return len(self.paths)

    def read(self, index: int, size: tuple[int, int] | None) -> Bytes:
        """See ImageSource."""
        return load_image(self.paths[index], size, self.bits)

    def digests(self) -> tuple[str, ...]:
        """Of the files; what cannot be read is told when it is looked at."""
        return tuple(digest_of_file(path) if path.is_file() else "missing" for path in self.paths)

    def part(self, indices: Items[int]) -> ImageFiles:
        """See ImageSource."""
        return ImageFiles(tuple(self.paths[i] for i in indices), self.bits)


class KeptImages:
    """Another source's images; the first ones that are read are kept, up to so many bytes, and are not to be changed.

    The stages of a run look at all images in their order, one stage after the other: the last would not help.
    Digests are made once: they read every byte, and several stages ask for them.
    """

    def __init__(self, source: ImageSource, max_bytes: int, digests: tuple[str, ...] | None = None) -> None:
        self.source, self._max_bytes, self._bytes = source, max_bytes, 0
        self._kept: dict[int, Bytes] = {}
        self._digests = digests

    @property
    def names(self) -> tuple[str, ...]:
        """See ImageSource."""
        return self.source.names

    def __len__(self) -> int:
        return len(self.source)

    def read(self, index: int, size: tuple[int, int] | None) -> Bytes:
        """See ImageSource."""
        kept = self._kept.get(index)
        if kept is not None and size in (None, (kept.shape[1], kept.shape[0])):
            return kept
        image = self.source.read(index, size)
        if self._bytes + image.nbytes <= self._max_bytes and kept is None:
            image.flags.writeable = False
            self._kept[index] = image
            self._bytes += image.nbytes
        return image

    def digests(self) -> tuple[str, ...]:
        """See ImageSource."""
        if self._digests is None:
            self._digests = self.source.digests()
        return self._digests

    def part(self, indices: Items[int]) -> KeptImages:
        """See ImageSource."""
        digests = None if self._digests is None else tuple(self._digests[i] for i in indices)
        return KeptImages(self.source.part(indices), self._max_bytes, digests)
