"""Pieces of HTML and SVG: text made safe, numbers made short, images and arrays put inside."""

from __future__ import annotations

import base64
import html
import json
import math
import re
from importlib import resources

import cv2

from meshslam.errors import MapError
from meshslam.geometry import AnyArray, Bytes, Floats

UNKNOWN = "&ndash;"
PNG_LEVEL = 6  # 9 takes ten times as long for 2%
# flat faces pack best without a filter: a quarter smaller than by differences; OpenCV has the choice from 4.11 on
PNG_FILTER = [cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE] if hasattr(cv2, "IMWRITE_PNG_FILTER") else []


def text(value: object) -> str:
    """Escape a value for HTML, attributes too."""
    return html.escape(str(value), quote=True)


def number(value: float | None, decimals: int) -> str:
    """HTML of a number with that many decimals; a dash for what is not known."""
    known = value is not None and math.isfinite(value)
    return f"{value:.{decimals}f}".replace("-", "&minus;") if known else UNKNOWN


def size_m(dimensions: Floats) -> str:
    """HTML of length, width and height (3,) in metres."""
    return " &times; ".join(number(v, 2) for v in dimensions.tolist())


def rgb(colour: AnyArray | tuple[int, int, int]) -> str:
    """A colour as #rrggbb."""
    r, g, b = (int(c) for c in colour)
    return f"#{r:02x}{g:02x}{b:02x}"


def table(headings: list[str], rows: list[list[str]], classes: str = "") -> str:
    """A table of ready HTML cells."""
    head = "".join(f"<th scope=col>{h}</th>" for h in headings)
    labels = [text(html.unescape(re.sub("<[^>]*>", "", heading))) for heading in headings]  # shown on narrow screens
    body = "".join("<tr>" + "".join(map(_cell, labels, row)) + "</tr>" for row in rows)
    return (
        f'<div class=scroll><table class="{classes}"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
    )


def _cell(label: str, content: str) -> str:
    return f'<td data-label="{label}">{content}</td>' if label else f"<td>{content}</td>"


def jpeg_uri(image: Bytes, quality: int = 80) -> str:
    """A BGR image as a data URI."""
    return f"data:image/jpeg;base64,{jpeg_base64(image, quality)}"


def jpeg_base64(image: Bytes, quality: int) -> str:
    """A BGR or grey image as a JPEG file in base64."""
    return base64.b64encode(_packed_as(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])).decode("ascii")


def png_uri(image: Bytes) -> str:
    """A BGR or BGRA image as a data URI."""
    return f"data:image/png;base64,{base64.b64encode(png_bytes(image)).decode('ascii')}"


def png_bytes(image: Bytes) -> bytes:
    """A BGR or BGRA image as a PNG file."""
    return _packed_as(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, PNG_LEVEL, *PNG_FILTER])


def _packed_as(suffix: str, image: Bytes, options: list[int]) -> bytes:
    done, content = cv2.imencode(suffix, image, options)
    if not done:
        raise MapError(f"a picture of shape {image.shape} for the report cannot be packed as {suffix[1:]}")
    return content.tobytes()


def packed(array: AnyArray) -> str:
    """An array's bytes, little-endian, as base64."""
    little = array.astype(array.dtype.newbyteorder("<"), copy=False)
    return base64.b64encode(little.tobytes()).decode("ascii")


def script_json(value: object) -> str:
    """JSON that cannot end the script element it stands in."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def asset(name: str) -> str:
    """A text file of this package."""
    return resources.files("meshslam.viewing").joinpath("assets", name).read_text(encoding="utf-8")


def script(*names: str) -> str:
    """Files of `assets/page` as one module: each sees the names of those before it."""
    return "\n".join(asset(f"page/{name}.js") for name in names)
