"""A small line chart as a picture, without Matplotlib: for the charts that every run draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from meshslam.geometry import AnyArray, Bytes, Floats
from meshslam.viewing.charts import Line
from meshslam.viewing.from_above import round_length_m
from meshslam.viewing.markup import png_bytes

WIDTH_PX, HEIGHT_PX = 624, 480
LEFT_PX, RIGHT_PX, TOP_PX, BOTTOM_PX = 60, 12, 30, 52  # margins around the axes
FINE = 2  # drawn at so many times the size, then reduced
SHIFT = 4  # bits of a pixel's fraction in drawing
TICKS = 7  # about so many an axis
MARKED = 30  # lines of fewer points show them
INK, GRID, THIN = (30, 30, 30), (228, 228, 228), (127, 127, 127)
CYCLE = ("1f77b4", "ff7f0e", "2ca02c", "d62728", "9467bd", "8c564b", "e377c2", "7f7f7f", "bcbd22", "17becf")  # RGB
WIDE_PX = 7  # a band
ROW_PX, KEY_PX = 17, 26  # of the legend


class Span(NamedTuple):
    """What an axis shows."""

    low: float
    high: float

    @property
    def ticks(self) -> Floats:
        """Round values inside, ascending."""
        step = round_length_m(1.5 * (self.high - self.low) / TICKS)
        return np.arange(np.ceil(self.low / step), np.floor(self.high / step + 1e-9) + 1) * step + 0.0


@dataclass(frozen=True, eq=False)
class Axes:
    """Values on the picture."""

    x: Span
    y: Span

    def pixels(self, x: Sequence[float] | Floats, y: Sequence[float] | Floats) -> Floats:
        """Pixels (n, 2) of values, y up."""
        across = (np.asarray(x, float) - self.x.low) / (self.x.high - self.x.low)
        up = (np.asarray(y, float) - self.y.low) / (self.y.high - self.y.low)
        width, height = WIDTH_PX - LEFT_PX - RIGHT_PX, HEIGHT_PX - TOP_PX - BOTTOM_PX
        return np.column_stack([LEFT_PX + width * across, HEIGHT_PX - BOTTOM_PX - height * up])


def line_picture(title: str, lines: Sequence[Line], x_label: str, y_label: str, *, equal: bool = False) -> bytes:
    """A PNG file of lines with a title, axes, a grid and a legend; `equal`: one scale for both axes.

    The same lines give the same bytes.
    """
    axes = _axes(lines, equal=equal)
    canvas = np.full((FINE * HEIGHT_PX, FINE * WIDTH_PX, 3), 255, np.uint8)
    _draw_grid(canvas, axes)
    for line, colour in zip(lines, _colours(lines), strict=True):
        _draw_line(canvas, axes.pixels(line.x, line.y), colour, _width(line), marked=len(line.x) < MARKED)
    _draw_frame(canvas)
    page = Image.fromarray(canvas[..., ::-1])
    _write_axes(page, axes, title, x_label, y_label)
    _write_legend(page, axes, lines)
    reduced = cv2.resize(np.asarray(page)[..., ::-1], (WIDTH_PX, HEIGHT_PX), interpolation=cv2.INTER_AREA)
    return png_bytes(np.asarray(reduced, np.uint8))


def _axes(lines: Sequence[Line], *, equal: bool) -> Axes:
    """Limits 5% beyond the values; of one scale if they are to be."""
    x = _span([value for line in lines for value in line.x])
    y = _span([value for line in lines for value in line.y])
    if equal:
        width, height = WIDTH_PX - LEFT_PX - RIGHT_PX, HEIGHT_PX - TOP_PX - BOTTOM_PX
        unit = max((x.high - x.low) / width, (y.high - y.low) / height)
        x, y = _of_length(x, unit * width), _of_length(y, unit * height)
    return Axes(x, y)


def _span(values: Sequence[float]) -> Span:
    low, high = (min(values), max(values)) if values else (0.0, 1.0)
    return _of_length(Span(low, high), 1.1 * max(high - low, 1e-6 * max(1.0, abs(low), abs(high))))


def _of_length(span: Span, length: float) -> Span:
    middle = (span.low + span.high) / 2
    return Span(middle - length / 2, middle + length / 2)


def _colours(lines: Sequence[Line]) -> list[tuple[int, int, int]]:
    """BGR of each line: those with a name go around the cycle."""
    found, place = [], 0
    for line in lines:
        number = place if line.colour is None else line.colour
        place += bool(line.name) and line.colour is None
        r, g, b = bytes.fromhex(CYCLE[number % len(CYCLE)])
        named = (pale(b), pale(g), pale(r)) if line.wide else (b, g, r)
        found.append(named if line.name else THIN)
    return found


def pale(value: int) -> int:
    """A colour's channel half way to white."""
    return (value + 255) // 2


def _fixed(pixels: Floats) -> AnyArray:
    return np.rint(pixels * FINE * (1 << SHIFT)).astype(np.int32)


def _draw_grid(canvas: Bytes, axes: Axes) -> None:
    for x in axes.x.ticks.tolist():
        ends = axes.pixels([x, x], axes.y)
        cv2.polylines(canvas, [_fixed(ends)], False, GRID, 1, cv2.LINE_AA, SHIFT)
    for y in axes.y.ticks.tolist():
        ends = axes.pixels(axes.x, [y, y])
        cv2.polylines(canvas, [_fixed(ends)], False, GRID, 1, cv2.LINE_AA, SHIFT)


def _width(line: Line) -> int:
    """Pixels of the fine picture."""
    return (WIDE_PX if line.wide else 2) * FINE if line.name else 2


def _draw_line(canvas: Bytes, pixels: Floats, colour: tuple[int, int, int], width: int, *, marked: bool) -> None:
    points = _fixed(pixels)
    cv2.polylines(canvas, [points], False, colour, width, cv2.LINE_AA, SHIFT)
    for x, y in points.tolist() if marked and width > 2 else ():
        cv2.circle(canvas, (x, y), 2 * FINE << SHIFT, colour, -1, cv2.LINE_AA, SHIFT)


def _draw_frame(canvas: Bytes) -> None:
    low, high = (FINE * LEFT_PX, FINE * TOP_PX), (FINE * (WIDTH_PX - RIGHT_PX), FINE * (HEIGHT_PX - BOTTOM_PX))
    cv2.rectangle(canvas, low, high, INK, FINE)


def _write(page: Image.Image, place: tuple[float, float], anchor: str, size_px: int, words: str) -> None:
    font = ImageFont.load_default(FINE * size_px)
    ImageDraw.Draw(page).text((FINE * place[0], FINE * place[1]), words, fill=INK, font=font, anchor=anchor)


def _write_axes(page: Image.Image, axes: Axes, title: str, x_label: str, y_label: str) -> None:
    bottom, middle = HEIGHT_PX - BOTTOM_PX, (LEFT_PX + WIDTH_PX - RIGHT_PX) / 2
    for x in axes.x.ticks.tolist():
        place, _ = axes.pixels([x], [axes.y.low])[0].tolist()
        _write(page, (place, bottom + 6), "mt", 12, f"{x:.6g}")
    for y in axes.y.ticks.tolist():
        _, place = axes.pixels([axes.x.low], [y])[0].tolist()
        _write(page, (LEFT_PX - 6, place), "rm", 12, f"{y:.6g}")
    _write(page, (middle, TOP_PX - 8), "mb", 15, title)
    _write(page, (middle, HEIGHT_PX - 10), "mb", 12, x_label)
    aside = Image.new("RGB", (FINE * 200, FINE * 20), "white")
    _write(aside, (100, 10), "mm", 12, y_label)
    turned = aside.rotate(90, expand=True)
    page.paste(turned, (0, FINE * (TOP_PX + bottom) // 2 - turned.height // 2))


def _write_legend(page: Image.Image, axes: Axes, lines: Sequence[Line]) -> None:
    """The names, in the corner of the axes that the fewest points share with them."""
    named = [(line.name, colour) for line, colour in zip(lines, _colours(lines), strict=True) if line.name]
    if not named:
        return
    font = ImageFont.load_default(FINE * 12)
    width = KEY_PX + 22 + max(font.getlength(name) for name, _ in named) / FINE
    height = ROW_PX * len(named) + 8
    points = np.concatenate([axes.pixels(line.x, line.y) for line in lines])
    left, right = LEFT_PX + 8.0, WIDTH_PX - RIGHT_PX - 8.0 - width
    top, bottom = TOP_PX + 8.0, HEIGHT_PX - BOTTOM_PX - 8.0 - height
    corners = [(right, top), (left, top), (right, bottom), (left, bottom)]
    hidden = [int(((points > c) & (points < np.add(c, (width, height)))).all(axis=1).sum()) for c in corners]
    x, y = corners[hidden.index(min(hidden))]
    drawing = ImageDraw.Draw(page)
    box = [FINE * v for v in (x, y, x + width, y + height)]
    drawing.rounded_rectangle(box, FINE * 3, fill="white", outline=(205, 205, 205), width=FINE)
    for row, (name, (b, g, r)) in enumerate(named):
        at = y + 4 + ROW_PX * (row + 0.5)
        drawing.line([FINE * v for v in (x + 8, at, x + 8 + KEY_PX, at)], fill=(r, g, b), width=2 * FINE)
        _write(page, (x + 14 + KEY_PX, at), "lm", 12, name)
