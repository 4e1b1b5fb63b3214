"""Image files: listing them by number, and reading them so that a damaged one is never taken for a good one."""

from __future__ import annotations

import io
import re
import warnings
import zlib
from collections.abc import Sequence as Items
from pathlib import Path

import cv2
import numpy as np
import simplejpeg
from PIL import Image

from meshslam.geometry import Bytes
from meshslam.sequences.report import Report, fail

SUFFIXES = (".png", ".jpg", ".jpeg")
MAX_PIXELS = 2**26  # 67 million: cameras have less, and a small file can claim far more
DEPTHS = (8, 10, 12, 14, 16)  # bits that sensors give
_SAMPLED_FRAMES = 5  # whose brightest pixel tells the depth
_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_JPEG_START = b"\xff\xd8"
_EXIF_ORIENTATION = 0x0112


def list_images(folder: Path) -> list[Path]:
    """PNG and JPEG files of a folder in the order of the numbers in their names; FoundError if there are none."""
    if not folder.is_dir():
        raise fail(folder, "", "no such folder")
    found = [p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and not p.name.startswith(".")]
    if not found:
        raise fail(folder, "", f"holds no images ({', '.join(SUFFIXES)}): the sequence is empty")
    return sorted(found, key=natural_key)


def natural_key(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Sorts names by the numbers in them: frame_2 before frame_10.

    >>> sorted(["frame_10.png", "frame_2.png"], key=lambda name: natural_key(Path(name)))
    ['frame_2.png', 'frame_10.png']
    """
    parts = re.split(r"([0-9]+)", path.stem)
    return [(int(part), "") if i % 2 else (0, part) for i, part in enumerate(parts)], path.name


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


def load_image(path: Path, size: tuple[int, int] | None = None, bits: int | None = None) -> Bytes:
    """Read a whole image as BGR (h, w, 3), turned as its EXIF entry says.

    An image of 16 bits a channel is scaled so that `bits` become 8; without `bits`, its own brightest pixel tells.
    FoundError if it is missing, damaged, cut short, larger than any camera's, or not of `size` (w, h).
    """
    return decode_image(path, _content(path), size, bits)


def decode_image(path: Path, content: bytes, size: tuple[int, int] | None = None, bits: int | None = None) -> Bytes:
    """`load_image` of content that is at hand; `path` is where it comes from, as errors name it."""
    if content.startswith(_PNG_SIGNATURE):
        image = _png(path, content, bits)
    elif content.startswith(_JPEG_START):
        image = _jpeg(path, content)
    else:
        raise fail(path, "", "neither a PNG nor a JPEG image" if content else "image is empty (0 bytes)")
    orientation = _orientation(content)
    image = _turned(image, orientation)
    height, width = image.shape[:2]
    if size is not None and (width, height) != size:
        turned = f" after its EXIF turn (orientation {orientation})" if orientation != 1 else ""
        expected = f"but the camera's resolution is {size[0]}x{size[1]}"
        raise fail(path, "", f"image is {width}x{height}{turned}, {expected}")
    return np.ascontiguousarray(image, np.uint8)


def image_bits(paths: Items[Path], report: Report) -> int | None:
    """Bits of a recording's images where they have more than 8, noted; None where they have 8.

    Sensors of 10, 12 and 14 bits are often stored in 16: the brightest pixel of a few frames tells.
    """
    if not paths or not _is_deep(_content(paths[0])):
        return None
    chosen = [paths[i] for i in np.unique(np.linspace(0, len(paths) - 1, _SAMPLED_FRAMES).astype(int))]
    bits = max((_bits_of(_decoded_png(path, _content(path))) for path in chosen), default=16)
    report.note(paths[0].parent, "", f"images of 16 bits a channel whose values have {bits} bits: scaled to 8")
    return bits


def note_turn(paths: Items[Path], report: Report) -> None:
    """Say that images are turned as their EXIF entry tells, if the first has one."""
    orientation = _orientation(_content(paths[0])) if paths else 1
    if orientation != 1:
        report.note(paths[0], "", f"images are turned as their EXIF orientation ({orientation}) says")


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise fail(path, "", "no such image") from None
    except OSError as error:
        raise fail(path, "", f"image cannot be read: {error.strerror}") from None


def _jpeg(path: Path, content: bytes) -> Bytes:
    """Decode by libjpeg, whose warnings are damage."""
    try:
        height, width, *_ = simplejpeg.decode_jpeg_header(content)
        _check_size(path, width, height)
        image: Bytes = simplejpeg.decode_jpeg(content, "BGR", strict=True)
    except ValueError as error:
        raise fail(path, "", f"JPEG is damaged: {str(error)[:100]}") from None
    return image


def _png(path: Path, content: bytes, bits: int | None) -> Bytes:
    image = _decoded_png(path, content)
    if image.dtype != np.uint16:
        return np.asarray(image, np.uint8)
    scale = 2.0 ** ((bits or _bits_of(image)) - 8)
    return np.minimum(image / scale, 255).astype(np.uint8)


def _decoded_png(path: Path, content: bytes) -> np.ndarray:
    """BGR (h, w, 3) of 8 or 16 bits."""
    damage = _png_damage(content)
    if damage:
        raise fail(path, "", damage)
    _check_size(path, int.from_bytes(content[16:20], "big"), int.from_bytes(content[20:24], "big"))
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    image = cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    if image is None:
        raise fail(path, "", "image cannot be decoded")
    return np.asarray(image)


def _check_size(path: Path, width: int, height: int) -> None:
    if width * height > MAX_PIXELS:
        raise fail(path, "", f"image of {width}x{height} pixels: more than {MAX_PIXELS} are not read")


def _is_deep(content: bytes) -> bool:
    return content.startswith(_PNG_SIGNATURE) and content[24:25] == b"\x10"


def _bits_of(image: np.ndarray) -> int:
    brightest = int(image.max())
    return next(bits for bits in DEPTHS if brightest < 2**bits)


def _orientation(content: bytes) -> int:
    """EXIF's orientation, 1 to 8; 1 where there is none."""
    if b"Exif\0" not in content[:65536] and b"eXIf" not in content[:65536]:
        return 1
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a damaged entry
        try:
            found = Image.open(io.BytesIO(content)).getexif().get(_EXIF_ORIENTATION, 1)
        except (OSError, ValueError, SyntaxError, TypeError, KeyError, Image.DecompressionBombError):
            return 1
    return found if isinstance(found, int) and 1 <= found <= 8 else 1


def _turned(image: Bytes, orientation: int) -> Bytes:
    """The image upright: mirrored, transposed or both (EXIF 2.3, table 6)."""
    if orientation >= 5:
        image = image.transpose(1, 0, 2)
    if orientation in (3, 4, 7, 8):
        image = image[::-1]
    if orientation in (2, 3, 6, 7):
        image = image[:, ::-1]
    return image


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
