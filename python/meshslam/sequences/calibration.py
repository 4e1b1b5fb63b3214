"""A lens from what a calibration file says of it."""

from __future__ import annotations

from pathlib import Path

from meshslam.errors import GeometryError
from meshslam.geometry import Camera, Floats
from meshslam.sequences.distortion import Distortion, coefficients_problem, undistorted
from meshslam.sequences.lenses import LENSES
from meshslam.sequences.report import Report, fail


def distortion_of(
    path: Path, keys: tuple[str, str], model: object, coefficients: Floats, raw: Camera, report: Report
) -> Distortion | None:
    """The lens of a model's name and its coefficients (n,), which stand in the file under `keys`; None for none.

    Which pinhole view was chosen is noted. FoundError for an unknown model, coefficients that do not fit it, or a model
    that folds over within the image.
    """
    if model == "none":
        if coefficients.any():
            raise fail(path, keys[0], f"is none, but {keys[1]} are given; expected {', '.join(LENSES)}")
        return None
    found = next((name for name in LENSES if name == model), None)
    if found is None:
        raise fail(path, keys[0], f"expected none, {', '.join(LENSES)}, found {str(model)[:60]!r}")
    problem = coefficients_problem(found, coefficients)
    if problem:
        raise fail(path, keys[1], problem)
    if not LENSES[found].is_wide and not coefficients.any():
        return None
    try:
        distortion, said = undistorted(raw, coefficients, found)
    except GeometryError as error:
        raise fail(path, keys[1], str(error)) from None
    if said:
        report.note(path, keys[0], said)
    return distortion
