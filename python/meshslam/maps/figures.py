"""The figures that a run left."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.errors import MapError


def read_figures(folder: Path) -> dict[str, Any]:
    """The figures of a run that is complete, and its `notes`; MapError if the file is not what a run wrote."""
    path = folder / "metrics.json"
    try:
        figures = json.loads(path.read_text(encoding="utf-8"))
        notes = figures.get("notes", [])
        numbers = [figures["frames"], *(value for key, value in figures.items() if key != "notes")]
        right = all(isinstance(value, int | float) and np.isfinite(value) for value in numbers)
        right = right and isinstance(notes, list) and all(isinstance(note, str) for note in notes)
    except (OSError, ValueError, LookupError, AttributeError, RecursionError, OverflowError):
        right = False
    if not right:
        raise MapError(f"{path}: is damaged: --overwrite makes the run anew")
    return dict(figures)
