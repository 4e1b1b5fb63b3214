"""Bring an image, or a part of it, to a network's input, and bring coordinates back."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from meshslam.geometry import Bytes, Floats, Singles
from meshslam.perception.preprocessing import Fit, Preprocessing

YOLO_INPUT = Preprocessing()
NATIVE_UP_TO = 1.1  # an image that fits and would be enlarged by less than this is not resampled at all


@dataclass(frozen=True)
class Letterbox:
    """A window of the image, scaled and set into an input of `height` x `width`.

    Along each axis `input = scale * (image - window) + pad`, for coordinates that count from the left or upper edge of
    the first pixel; the centre of pixel i is at i + 0.5.
    """

    window: tuple[int, int, int, int]  # x0, y0, x1, y1: px of the image, x1 and y1 excluded
    scale: tuple[float, float]  # x, y; the same unless the image is stretched
    pad: tuple[int, int]  # x, y: px of the input
    height: int
    width: int

    @staticmethod
    def fit(window: tuple[int, int, int, int], height: int, width: int, fit: Fit = "letterbox") -> Letterbox:
        """Centre a window in an input, as large as fits; or stretch it over the input."""
        x0, y0, x1, y1 = window
        if fit == "stretch":
            return Letterbox(window, (width / (x1 - x0), height / (y1 - y0)), (0, 0), height, width)
        scale = min(height / (y1 - y0), width / (x1 - x0))
        if 1 <= scale < NATIVE_UP_TO:
            scale = 1.0
        pad_x = (width - round((x1 - x0) * scale)) // 2
        pad_y = (height - round((y1 - y0) * scale)) // 2
        return Letterbox(window, (scale, scale), (max(0, pad_x), max(0, pad_y)), height, width)

    def image_to_input(self, image_bgr: Bytes, expected: Preprocessing = YOLO_INPUT) -> Singles:
        """Return the (1, 3, height, width) input; RGB in [0, 1] unless the network expects another."""
        x0, y0, x1, y1 = self.window
        part = image_bgr[y0:y1, x0:x1]
        columns = min(self.width, max(1, round((x1 - x0) * self.scale[0])))
        rows = min(self.height, max(1, round((y1 - y0) * self.scale[1])))
        if (rows, columns) != part.shape[:2]:
            method = cv2.INTER_AREA if min(self.scale) < 1 and expected.antialias else cv2.INTER_LINEAR
            part = np.asarray(cv2.resize(part, (columns, rows), interpolation=method), np.uint8)
        canvas = np.full((self.height, self.width, 3), expected.fill, np.uint8)
        canvas[self.pad[1] : self.pad[1] + rows, self.pad[0] : self.pad[0] + columns] = part
        return expected.values(canvas)

    def boxes_to_image(self, boxes: Floats) -> Floats:
        """Take boxes (N, 4) x0, y0, x1, y1 from the input to the image, cut at the window."""
        offset = np.array([*self.window[:2], *self.window[:2]], float)
        moved = (boxes - np.tile(self.pad, 2)) / np.tile(self.scale, 2) + offset
        low, high = np.tile(self.window[:2], 2), np.tile(self.window[2:], 2)
        cut: Floats = np.clip(moved, low, high)
        return cut

    def interpolation(
        self, axis: int, first: int, last: int, cells: int, extent: tuple[float, float] | None = None
    ) -> tuple[slice, Singles]:
        """Find weights that take a grid of `cells` over the input to the image's pixels first..last - 1.

        `axis` 0 is x, 1 is y. The grid covers `extent` (from, to: px of the input), or all of it. Linear between the
        cells' centres, constant beyond the outermost. Returns the part of the grid that is needed, and weights
        (last - first, needed).
        """
        low, high = extent or (0.0, float((self.width, self.height)[axis]))
        cell_px = max(high - low, 1e-6) / cells
        centres = np.arange(first, last) + 0.5
        place = ((centres - self.window[axis]) * self.scale[axis] + self.pad[axis] - low) / cell_px - 0.5
        place = np.clip(place, 0, cells - 1)
        needed = slice(int(place[0]), min(cells, int(place[-1]) + 2))
        weights = np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(needed.start, needed.stop)))
        return needed, weights.astype(np.float32)
