"""VINS-Fusion's configuration: files of cameras by cam0_calib, cam1_calib, and where they sit by body_T_cam0."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from meshslam.sequences.cameras.camodocal import Camodocal, note_first_guess
from meshslam.sequences.cameras.found import FoundCamera, number_of
from meshslam.sequences.report import Report, fail
from meshslam.sequences.text import pose_of, read_yaml


@dataclass(frozen=True)
class VinsFusion:
    """See CameraFormat. The body is the IMU."""

    name: str = "VINS-Fusion configuration"

    def cameras(self, content: Mapping[str, Any]) -> dict[int, str]:
        """Those that the file names, as many as it says there are."""
        count = content.get("num_of_cam")
        known = count if isinstance(count, int) else 2
        return {n: f"cam{n}_calib" for n in range(2) if f"cam{n}_calib" in content and n < known}

    def read(self, path: Path, content: Mapping[str, Any], number: int, report: Report) -> FoundCamera:
        """The camera's own file, which lies beside, with its mounting."""
        key, mounted = f"cam{number}_calib", f"body_T_cam{number}"
        file = path.parent / str(content[key])
        if not file.is_file():
            raise fail(path, key, f"names {str(content[key])[-80:]!r}, which is not there: put it beside this file")
        inner = read_yaml(file)
        if "model_type" not in inner:
            raise fail(file, "model_type", "key is missing: expected camodocal's camera, which VINS-Fusion reads")
        found = Camodocal().read(file, inner, 0, report)
        pose = None if content.get(mounted) is None else pose_of(path, mounted, content[mounted], report)
        note_first_guess(path, content, report)
        ahead_s = number_of(path, "td", content.get("td") or 0.0)
        return replace(found, imu_from_camera=pose, imu_ahead=("td", ahead_s))
