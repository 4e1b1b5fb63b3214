"""Chunks and messages that are compressed: never more than a limit comes out."""

from __future__ import annotations

import bz2
import io
from pathlib import Path

from meshslam.sequences.bags.store import LARGEST_CHUNK
from meshslam.sequences.report import fail

COMMANDS = {  # that unpack a whole file beside it, by its suffix
    ".gz": "gunzip -k",
    ".bz2": "bunzip2 -k",
    ".xz": "unxz -k",
    ".lz4": "unlz4 -k",
    ".zst": "zstd -d",
    ".zstd": "zstd -d",
}


def unpacking_command(path: Path, suffixes: tuple[str, ...]) -> str:
    """What unpacks a file that is a bag of one of these suffixes, compressed as a whole; empty for any other.

    >>> unpacking_command(Path("drive.bag.gz"), (".bag",))
    'gunzip -k drive.bag.gz'
    """
    command = COMMANDS.get(path.suffix.lower())
    if command is None or path.with_suffix("").suffix.lower() not in suffixes:
        return ""
    out = f" -o {path.with_suffix('').name}" if path.suffix.lower() == ".zstd" else ""  # which zstd does not know
    return f"{command} {path.name}{out}"


def unpacked(path: Path, where: str, kind: str, data: bytes) -> bytes:
    """Bytes of a chunk compressed by lz4, bz2, zstd or not at all; FoundError if it is damaged or too large."""
    if kind in ("", "none"):
        return data
    if kind not in ("lz4", "bz2", "zstd"):
        raise fail(path, where, f"compression {kind!r:.40} is not read, only lz4, bz2 and zstd are")
    try:
        found = _unpacked(kind, data)
    except Exception as error:  # each library has its own
        raise fail(path, where, f"a chunk compressed by {kind} is damaged: {str(error)[:100]}") from None
    if len(found) > LARGEST_CHUNK:
        raise fail(path, where, f"a chunk of {kind} has more than {LARGEST_CHUNK >> 20} MiB unpacked: not read")
    return found


def _unpacked(kind: str, data: bytes) -> bytes:
    most = LARGEST_CHUNK + 1
    if kind == "bz2":
        return bz2.BZ2Decompressor().decompress(data, most)
    if kind == "lz4":
        import lz4.frame

        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most))
    import zstandard

    with zstandard.ZstdDecompressor().stream_reader(io.BytesIO(data)) as stream:
        return bytes(stream.read(most))
