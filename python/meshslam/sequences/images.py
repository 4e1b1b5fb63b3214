"""Image files: listing them by number, and reading them so that a damaged one is never taken for a good one."""

from __future__ import annotations

import zlib
from pathlib import Path

import cv2
import numpy as np

from meshslam.geometry import Bytes
from meshslam.sequences.report import fail

SUFFIXES = (".png", ".jpg", ".jpeg")
_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_JPEG_START, _JPEG_END = b"\xff\xd8", b"\xff\xd9"


def list_images(folder: Path) -> list[Path]:
    """PNG and JPEG files of a folder: by number where every name is one, else by name; FoundError if there are none."""
    if not folder.is_dir():
        raise fail(folder, "", "no such folder")
    found = [p for p in sorted(folder.iterdir()) if p.suffix.lower() in SUFFIXES and not p.name.startswith(".")]
    if not found:
        raise fail(folder, "", f"holds no images ({', '.join(SUFFIXES)}): the sequence is empty")
    return sorted(found, key=lambda p: int(p.stem)) if are_numbered(found) else found


def are_numbered(paths: list[Path]) -> bool:
    """Whether every file name is a frame number."""
    return all(p.stem.isascii() and p.stem.isdigit() for p in paths)


def frame_numbers(paths: list[Path]) -> tuple[int, ...]:
    """Frame numbers from file names like 000012.png; FoundError at the first that is none or comes twice."""
    numbers: list[int] = []
    for path in paths:
        if not are_numbered([path]):
            raise fail(path, "", "the file's name is no frame number, expected one like 000012.png")
        if numbers and int(path.stem) == numbers[-1]:
            raise fail(path, "", f"a second image of frame {numbers[-1]}")
        numbers.append(int(path.stem))
    return tuple(numbers)


def load_image(path: Path, size: tuple[int, int] | None = None) -> Bytes:
    """Read a whole image as BGR (h, w, 3); FoundError if it is missing, damaged, cut short or not of `size` (w, h)."""
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise fail(path, "", "no such image") from None
    except OSError as error:
        raise fail(path, "", f"image cannot be read: {error.strerror}") from None
    damage = _damage(content)
    if damage:
        raise fail(path, "", damage)
    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    if image is None:
        raise fail(path, "", "image cannot be decoded")
    height, width = image.shape[:2]
    if size is not None and (width, height) != size:
        raise fail(path, "", f"image is {width}x{height}, but the camera's resolution is {size[0]}x{size[1]}")
    return np.asarray(image, np.uint8)


def _damage(content: bytes) -> str:
    """Say what is wrong with a file's bytes, empty if nothing: OpenCV fills up a file that is cut short in silence."""
    if content.startswith(_PNG_SIGNATURE):
        return _png_damage(content)
    if content.startswith(_JPEG_START):
        return "" if _JPEG_END in content[-1024:] else "JPEG is truncated: its end marker is missing"
    return "neither a PNG nor a JPEG image" if content else "image is empty (0 bytes)"


def _png_damage(content: bytes) -> str:
    at = len(_PNG_SIGNATURE)
    while at + 12 <= len(content):
        length = int.from_bytes(content[at : at + 4], "big")
        body, end = content[at + 4 : at + 8 + length], at + 12 + length
        if end > len(content):
            break
        if zlib.crc32(body) != int.from_bytes(content[end - 4 : end], "big"):
            return f"PNG is damaged at byte {at}: a chunk's checksum is wrong"
        if body[:4] == b"IEND":
            return ""
        at = end
    return f"PNG is truncated: it ends at byte {len(content)} before its last chunk"
