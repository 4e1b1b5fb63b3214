"""Where a path leads."""

from __future__ import annotations

import os
from pathlib import Path


def real_path(path: Path | str) -> Path:
    """The absolute path without links, as far as they lead anywhere; `Path.resolve` raises for links in a circle."""
    return Path(os.path.realpath(path))
