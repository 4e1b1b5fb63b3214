"""Objects, path and cameras as binary glTF 2.0."""

from __future__ import annotations

from pathlib import Path

from meshslam.exporting.finished_run import FinishedRun
from meshslam.exporting.formats import Notes
from meshslam.maps import to_glb


def write(run: FinishedRun, target: Path) -> Notes:
    """As map.glb, and a camera for each frame; a camera's principal point is in its `extras` alone."""
    target.write_bytes(to_glb(run.scene, run.path, run.camera, run.frame_ids))
    return ()
