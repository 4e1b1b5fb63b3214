"""camodocal's YAML, which VINS and KITTI-360's fisheyes have: model_type and projection_parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.geometry import Pose
from meshslam.sequences.cameras.found import FoundCamera, brown, needed, number_of, row_of, size_of
from meshslam.sequences.report import Report, fail
from meshslam.sequences.text import rigid

_PINHOLE, _FISHEYE = ("fx", "fy", "cx", "cy"), ("mu", "mv", "u0", "v0")


@dataclass(frozen=True)
class Camodocal:
    """See CameraFormat."""

    name: str = "camodocal (VINS, KITTI-360's fisheyes)"

    def cameras(self, content: Mapping[str, Any]) -> dict[int, str]:
        """The one camera."""
        return {0: str(content.get("camera_name") or "the camera")[:40]} if "model_type" in content else {}

    def read(self, path: Path, content: Mapping[str, Any], number: int, report: Report) -> FoundCamera:
        """Read it: PINHOLE and KANNALA_BRANDT; other models have a mirror or a polynomial, and are refused."""
        kind = str(content["model_type"])
        if kind not in ("PINHOLE", "KANNALA_BRANDT"):
            raise fail(
                path,
                "model_type",
                f"{kind[:40]!r} is not read (MEI has a mirror), only PINHOLE and KANNALA_BRANDT: take KITTI-360's "
                "rectified cameras (perspective.txt), or calibrate the fisheye as equidistant",
            )
        size = [needed(path, content, key) for key in ("image_width", "image_height")]
        wide = kind == "KANNALA_BRANDT"
        values = _named(path, content, "projection_parameters", _FISHEYE if wide else _PINHOLE)
        bent = "projection_parameters" if wide else "distortion_parameters"
        names = ("k2", "k3", "k4", "k5") if wide else ("k1", "k2", "p1", "p2")
        coefficients = np.array(_named(path, content, bent, names))
        model, coefficients = ("equidistant", coefficients) if wide else brown(coefficients)
        return FoundCamera(
            size_of(path, "image_width, image_height", size),
            np.array([*values, 0.0]),
            model,
            coefficients,
            ("projection_parameters", "model_type", bent),
            _mounting(path, content, report),
            ("td", number_of(path, "td", content.get("td") or 0.0)),
        )


def _mounting(path: Path, content: Mapping[str, Any], report: Report) -> Pose | None:
    """VINS-Mono's configuration has the camera and imu^R_cam, imu^T_cam in one file."""
    rotation, translation = content.get("extrinsicRotation"), content.get("extrinsicTranslation")
    if rotation is None or translation is None or content.get("estimate_extrinsic") == 2:  # 2: not known at all
        return None
    turn = row_of(path, "extrinsicRotation", rotation, 9).reshape(3, 3)
    note_first_guess(path, content, report)
    return rigid(
        path, "extrinsicRotation", np.column_stack([turn, row_of(path, "extrinsicTranslation", translation, 3)]), report
    )


def note_first_guess(path: Path, content: Mapping[str, Any], report: Report) -> None:
    """Say where VINS itself does not trust the mounting."""
    if content.get("estimate_extrinsic") == 1:
        report.note(path, "estimate_extrinsic", "is 1: the mounting is a first guess, which VINS refines and we do not")


def _named(path: Path, content: Mapping[str, Any], key: str, names: tuple[str, ...]) -> list[float]:
    part = needed(path, content, key)
    if not isinstance(part, dict):
        raise fail(path, key, f"expected the keys {', '.join(names)}")
    return [number_of(path, f"{key}: {n}", needed(path, part, n, f"{key}: ")) for n in names]
