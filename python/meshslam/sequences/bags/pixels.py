"""Image messages as BGR: raw ones by their encoding and row length, compressed ones by their content."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from meshslam.geometry import Bytes
from meshslam.sequences.images import DEPTHS, MAX_PIXELS, decode_image
from meshslam.sequences.report import FoundError, fail

# OpenCV calls a mosaic by the second row's second and third pixel, ROS by the first row's first two
_BAYER = {
    "rggb": cv2.COLOR_BayerBG2BGR,
    "bggr": cv2.COLOR_BayerRG2BGR,
    "gbrg": cv2.COLOR_BayerGR2BGR,
    "grbg": cv2.COLOR_BayerGB2BGR,
}
_DEPTH = ("16UC1", "16SC1", "32FC1", "64FC1")  # distances (REP 118), not what a camera sees
_CODES = {  # (channels, bytes a channel, conversion to BGR)
    "mono8": (1, 1, cv2.COLOR_GRAY2BGR),
    "8UC1": (1, 1, cv2.COLOR_GRAY2BGR),
    "mono16": (1, 2, cv2.COLOR_GRAY2BGR),
    "bgr8": (3, 1, None),
    "8UC3": (3, 1, None),
    "rgb8": (3, 1, cv2.COLOR_RGB2BGR),
    "bgr16": (3, 2, None),
    "rgb16": (3, 2, cv2.COLOR_RGB2BGR),
    "bgra8": (4, 1, cv2.COLOR_BGRA2BGR),
    "8UC4": (4, 1, cv2.COLOR_BGRA2BGR),
    "rgba8": (4, 1, cv2.COLOR_RGBA2BGR),
    **dict.fromkeys(("yuv422", "uyvy"), (2, 1, cv2.COLOR_YUV2BGR_UYVY)),
    **dict.fromkeys(("yuv422_yuy2", "yuyv"), (2, 1, cv2.COLOR_YUV2BGR_YUY2)),
    **{f"bayer_{name}8": (1, 1, code) for name, code in _BAYER.items()},
    **{f"bayer_{name}16": (1, 2, code) for name, code in _BAYER.items()},
}


def form_of(message: Any) -> str:  # noqa: ANN401 # by the schema
    """An image's encoding, or the format of a compressed one."""
    return str(getattr(message, "encoding", "") or getattr(message, "format", ""))


def is_depth(form: str) -> bool:
    """Whether an encoding or format is that of depth images."""
    return form in _DEPTH or "compressedDepth" in form


def image_of(path: Path, where: str, message: Any, size: tuple[int, int] | None, bits: int | None) -> Bytes:  # noqa: ANN401
    """An Image or CompressedImage, of ROS or Foxglove, as BGR (h, w, 3); FoundError for what is damaged or unknown.

    Values of 16 bits are scaled so that `bits` become 8; without `bits`, the image's own brightest pixel tells.
    """
    if not hasattr(message, "encoding"):
        return _compressed(path, where, message, size, bits)
    values, code = _values(path, where, message)
    height, width = values.shape[:2]
    if size is not None and (width, height) != size:
        raise fail(path, where, f"image is {width}x{height}, but the camera's resolution is {size[0]}x{size[1]}")
    if values.dtype == np.uint16:
        values = _of_8_bits(values, bits)
    image = values if code is None else cv2.cvtColor(np.ascontiguousarray(values), code)
    return np.ascontiguousarray(image, np.uint8)


def bits_of(path: Path, where: str, message: Any) -> int | None:  # noqa: ANN401 # by the schema
    """Bits of a raw image's brightest pixel where it has 16 a channel; None elsewhere."""
    if not hasattr(message, "encoding"):
        return None
    values, _ = _values(path, where, message)
    return None if values.dtype != np.uint16 else _depth(values)


def _depth(values: np.ndarray) -> int:
    brightest = int(values.max())
    return next(bits for bits in DEPTHS if brightest < 2**bits)


def _of_8_bits(values: np.ndarray, bits: int | None) -> Bytes:
    scale = 2.0 ** ((bits or _depth(values)) - 8)
    return np.minimum(values / scale, 255).astype(np.uint8)


def _values(path: Path, where: str, message: Any) -> tuple[np.ndarray, int | None]:  # noqa: ANN401 # by the schema
    """Values (h, w[, channels]) of 8 or 16 bits, rows' padding left out, and OpenCV's conversion to BGR."""
    encoding, width, height = str(message.encoding), int(message.width), int(message.height)
    known = _CODES.get(encoding)
    if is_depth(encoding):
        raise fail(path, where, f"{encoding} is a depth image's encoding: choose the camera's topic by --topic image=…")
    if known is None:
        raise fail(path, where, f"unknown encoding {encoding!r:.40}: known are {', '.join(_CODES)}"[:280])
    channels, depth, code = known
    if not 0 < width * height <= MAX_PIXELS:
        raise fail(path, where, f"image of {width}x{height} pixels: between 1 and {MAX_PIXELS} are read")
    data = np.frombuffer(bytes_of(message.data), np.uint8)
    row, step = width * channels * depth, int(message.step) or width * channels * depth
    if step < row or len(data) < step * (height - 1) + row:
        expected = f"{height} rows of {row} bytes every {step}"
        raise fail(path, where, f"{len(data)} bytes for an image {encoding} of {width}x{height}: expected {expected}")
    rows = np.lib.stride_tricks.as_strided(data, (height, row), (step, 1), writeable=False)
    shape = (height, width) if channels == 1 else (height, width, channels)
    order = ">" if getattr(message, "is_bigendian", 0) else "<"
    values = np.ascontiguousarray(rows).view(f"{order}u{depth}").reshape(shape)
    return values.astype(np.uint16 if depth == 2 else np.uint8, copy=False), code


def bytes_of(data: Any) -> bytes:  # noqa: ANN401 # arrays, bytes, base64 in JSON
    """A message's data."""
    if isinstance(data, str):
        return base64.b64decode(data)
    return data.tobytes() if isinstance(data, np.ndarray) else bytes(data)


def _compressed(path: Path, where: str, message: Any, size: tuple[int, int] | None, bits: int | None) -> Bytes:  # noqa: ANN401
    form = str(getattr(message, "format", ""))
    if is_depth(form):
        raise fail(path, where, f"{form!r:.60} is a depth image's format: choose the camera's topic by --topic image=…")
    try:
        image = decode_image(path, bytes_of(message.data), size, bits)
    except FoundError as error:
        raise fail(path, where, f"{error.problem.what} (format {form!r:.60})") from None
    mosaic = form.rpartition("compressed ")[2].strip()
    code = _CODES[mosaic][2] if mosaic.startswith("bayer_") and mosaic in _CODES else None
    return image if code is None else np.asarray(cv2.cvtColor(np.ascontiguousarray(image[..., 0]), code), np.uint8)
