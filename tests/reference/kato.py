"""Kato's approximate gradient, one scalar at a time: the slow twin of core/gradients/kato.

Per face, edge, axis and scanline, an outward and an inward pass; a pixel counts only if its change lowers the loss, with
weight 1/distance (Kato, Ushiku and Harada 2018, Sec. 3, as their renderer does it). Pixel coordinates throughout.
"""

from __future__ import annotations

import math

import numpy as np

EPSILON_PX = 1e-3


def pixel_gradient(pixels, faces, face_index, slope):
    """dL/d(pixels) (V, 2) from which face each pixel shows (h, w) and the loss's slope over its colour (h, w)."""
    out = np.zeros((len(pixels), 2))
    for number in range(len(faces)):
        corners = list(faces[number])
        (ax, ay), (bx, by), (cx, cy) = pixels[corners]
        if (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) > 0:
            corners[1], corners[2] = corners[2], corners[1]
        for edge in range(3):
            ends = [corners[(edge + k) % 3] for k in range(3)]
            for axis in range(2):
                points = [(float(pixels[v][axis]), float(pixels[v][1 - axis])) for v in ends]
                first, second = edge_pull(points, number, axis, face_index, slope)
                out[ends[0], 1 - axis] += first
                out[ends[1], 1 - axis] += second
    return out


def edge_pull(points, number, axis, face_index, slope):
    (p0, p1), (q0, q1), (r0, r1) = points
    if axis == 1:  # pictures are [row, column]: the first index is across for axis 0
        face_index, slope = face_index.T, slope.T
    across_size, along_size = face_index.shape
    drawn = (face_index >= 0).astype(float)
    pulls = [0.0, 0.0]

    def pull(gain, d0, d1, crossing):
        if q0 != d0:
            distance = (q0 - p0) / (q0 - d0) * (d1 - crossing)
            pulls[0] -= gain / (distance + EPSILON_PX if distance > 0 else distance - EPSILON_PX)
        if p0 != d0:
            distance = (q0 - p0) / (d0 - p0) * (d1 - crossing)
            pulls[1] -= gain / (distance + EPSILON_PX if distance > 0 else distance - EPSILON_PX)

    if p0 == q0:
        return pulls
    direction = (1 if p0 < q0 else -1) * (1 if axis == 0 else -1)
    for d0 in range(max(math.ceil(min(p0, q0)), 0), min(math.floor(max(p0, q0)), along_size - 1) + 1):
        crossing = (q1 - p1) / (q0 - p0) * (d0 - p0) + p1
        d1_in = math.floor(crossing) if direction > 0 else math.ceil(crossing)
        d1_out = d1_in + direction
        if not (0 <= d1_in < across_size and 0 <= d1_out < across_size):
            continue
        if face_index[d1_in, d0] == number:  # outward
            limit = across_size - 1 if direction > 0 else 0
            for d1 in range(min(d1_out, limit), max(d1_out, limit) + 1):
                gain = (drawn[d1, d0] - drawn[d1_in, d0]) * slope[d1, d0]
                if gain > 0:
                    pull(gain, d0, d1, crossing)
        if (d0 - p0) * (d0 - r0) < 0:  # inward, to where the scanline leaves the face
            other = (r1 - p1) / (r0 - p0) * (d0 - p0) + p1
        else:
            other = (q1 - r1) / (q0 - r0) * (d0 - r0) + r1 if q0 != r0 else 0.0
        limit = math.ceil(other) if direction > 0 else math.floor(other)
        for d1 in range(max(min(d1_in, limit), 0), min(max(d1_in, limit), across_size - 1) + 1):
            if face_index[d1, d0] != number:
                continue
            gain = (drawn[d1, d0] - drawn[d1_out, d0]) * slope[d1, d0]
            if gain > 0:
                pull(gain, d0, d1, crossing)
    return pulls
