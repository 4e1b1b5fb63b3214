"""What a loader is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from meshslam.sequences.report import Report
from meshslam.sequences.sequence import Sequence


@dataclass(frozen=True)
class LoadOptions:
    """What the user may choose about a recording."""

    camera_number: int | None = None  # of layouts with several cameras; None: the layout's usual one
    detections_path: Path | None = None  # instead of the layout's own


class Loader(Protocol):
    """Reads one layout."""

    @property
    def name(self) -> str:
        """The layout's name, as `--layout` takes it."""

    @property
    def looks_for(self) -> str:
        """What a folder of this layout is known by, in words."""

    def recognizes(self, path: Path) -> bool:
        """Whether the folder looks like this layout; opens no file."""

    def image_files(self, path: Path, options: LoadOptions) -> list[Path]:
        """List the camera's images by frame; empty where the layout can do without; SequenceError where it cannot."""

    def load(self, path: Path, options: LoadOptions, report: Report) -> Sequence:
        """Read all but the images; every problem goes to `report`, SequenceError is raised where nothing is left."""
