"""Write the table of measured figures into README.md and docs/results.md, from docs/results.json.

.venv/bin/python scripts/results_table.py [--check]

Benchmarks write docs/results.json. The table stands between two marks. `--check` only says whether it is as the
figures make it.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "docs" / "results.json"
PAGES = (ROOT / "README.md", ROOT / "docs" / "results.md")
BEGIN, END = "<!-- figures: scripts/results_table.py -->", "<!-- end of figures -->"
ROWS = (
    (
        "`map`, KITTI raw 0048, masks of a 4 MB network",
        "{a[objects]:.0f} cars, mask IoU {a[mask_iou_mean]:.2f}, {a[share_mapped]:.0%} of all car detections at least "
        "40 px wide mapped",
        "map 0048",
    ),
    (
        "`map`, KITTI odometry 06, 51 grey frames",
        "lidar to mesh {a[car_35_median_m]:.2f} m and {a[car_38_median_m]:.2f} m in the median on the two cars passed "
        "closely",
        "map 06",
    ),
    (
        "`map`, 24 car models from 8, 3, 2, 1 views in a ring, noisy masks and key points",
        "voxel IoU {a[voxel IoU]:.2f}, {b[voxel IoU]:.2f}, {c[voxel IoU]:.2f}, {d[voxel IoU]:.2f}",
        "shape ring8",
        "shape ring3",
        "shape ring2",
        "shape ring1",
    ),
    (
        "`map`, KITTI streets with real car models, passed on one side",
        "voxel IoU {a[voxel IoU]:.2f}, {a[recall]:.1%} of the cars, centres to {a[centre m]:.2f} m in the median",
        "shape street",
    ),
    (
        "`localize`, KITTI 06's real IMU, true meshes as the map, 70 frames, four starts",
        "{a[ate_m].range:.3f} m and {a[rotation_deg].range:.2f}° (IMU alone: {a[ate_imu_alone_m].range:.1f} m)",
        "localize clean",
    ),
    (
        "`localize` in the map that `map` made of another pass",
        "{a[ate_m].range:.3f} m",
        "localize mapped in another pass",
    ),
    (
        "`localize`, 0048's right camera in the map from its left one",
        "{a[ate_m]:.2f} m against OXTS",
        "localize 0048, right camera",
    ),
    (
        "`slam`, 70 frames, 6 cars, no poses",
        "{a[ate_m].count} cases: end error {a[end_error_percent].mean:.2f}% of the distance in the mean, "
        "{a[end_error_percent].high:.2f}% at most; voxel IoU of all cars {a[voxel_iou_aligned].mean:.2f}, "
        "aligned",
        "slam",
    ),
    (
        "`slam` without `initial_state.yaml`, four starts",
        "aligned ATE {a[ate_aligned_percent].range:.1f}% of the distance",
        "slam, no start",
    ),
    (
        "`slam`, all of KITTI 06 with its loop, 1,233 m",
        "position error {a[ate_m].mean:.1f} m with track ids, {b[ate_m].mean:.1f} m without; "
        "{b[cars_found].mean:.0f} of {b[cars].mean:.0f} cars, {b[cars_twice].mean:.0f} twice",
        "slam, whole drive",
        "slam, whole drive, no ids",
    ),
    (
        "`slam`, KITTI odometry 06, 51 grey frames, no poses",
        "end error {a[end_error_percent].mean:.1f}% with the IMU, {b[end_error_percent].mean:.1f}% by images alone",
        "real 06, IMU",
        "real 06, images alone",
    ),
    (
        "`slam --live`, the same drive at 10 Hz on two cores, with its network",
        "95% of the poses within {a[latency_p95_s].high:.2f} s, end error {a[end_error_percent].range:.1f}%",
        "slam --live 06",
    ),
)


class Values:
    """The figures of several cases of one kind, as a format asks for them."""

    def __init__(self, values: list[float]) -> None:
        self.low, self.high, self.mean, self.count = min(values), max(values), float(np.mean(values)), len(values)

    @property
    def range(self) -> Range:
        """From the smallest to the largest."""
        return Range(self)


class Range:
    """Two numbers with a dash, one where both read the same."""

    def __init__(self, values: Values) -> None:
        self.values = values

    def __format__(self, digits: str) -> str:
        low, high = (format(value, digits) for value in (self.values.low, self.values.high))
        return low if low == high else f"{low} to {high}"


def figures_of(results: dict[str, Any], case: str) -> dict[str, Any]:
    """A case's figures; lists can be asked for their range."""
    return {
        name: Values(value) if isinstance(value, list) else value for name, value in results[case]["figures"].items()
    }


def table(results: dict[str, Any]) -> str:
    """The table as Markdown."""
    lines = ["| case | figure |", "| --- | --- |"]
    for title, figure, *cases in ROWS:
        named = {letter: figures_of(results, case) for letter, case in zip("abcd", cases, strict=False)}
        lines.append(f"| {title} | {figure.format(**named)} |")
    return "\n".join(lines)


def with_table(page: str, made: str) -> str:
    """A page with the table between its marks."""
    before, rest = page.split(BEGIN)
    return f"{before}{BEGIN}\n{made}\n{END}{rest.split(END)[1]}"


def main() -> int:
    """Write, or check."""
    made = table(json.loads(RESULTS.read_text(encoding="utf-8")))
    stale = []
    for page in PAGES:
        found = page.read_text(encoding="utf-8")
        right = with_table(found, made)
        if right != found:
            stale.append(page.name)
            if "--check" not in sys.argv:
                page.write_text(right, encoding="utf-8")
    if stale and "--check" in sys.argv:
        sys.stderr.write(
            f"{', '.join(stale)}: the figures are not those of docs/results.json: scripts/results_table.py\n"
        )
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
