"""A recording of any layout, written as a sequence folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from meshslam.sequences import Sequence


def convert_recording(recording: Sequence, out: Path, *, overwrite: bool) -> None:
    """Write frame by frame, and put the folder in place once it is whole."""
    import sys
    from functools import partial

    from meshslam.cli.progress import progress_bars
    from meshslam.errors import SequenceError
    from meshslam.files import real_path, replaced_folder
    from meshslam.sequences import copy_as_folder

    place = real_path(out)
    if real_path(recording.root).is_relative_to(place) or Path.cwd().is_relative_to(place):
        raise SequenceError(f"{out}: the recording, or the command's own folder, is in there: name another folder")
    place.parent.mkdir(parents=True, exist_ok=True)
    check = partial(_refuse_foreign, out, overwrite=overwrite)
    with progress_bars() as bars, replaced_folder(place, (), check, SequenceError) as part:
        notes = copy_as_folder(recording, part, partial(bars, "convert"))
    for note in (*recording.notes, *notes):
        print(f"note: {note}", file=sys.stderr)
    poses = len(recording.world_from_camera or recording.partial_poses or ())
    samples = 0 if recording.imu is None else len(recording.imu.times_s)
    print(f"{out}: {len(recording)} frames, {poses} poses, {samples} IMU samples")


def _refuse_foreign(out: Path, *, overwrite: bool) -> None:
    from meshslam.errors import SequenceError
    from meshslam.files import LIST

    if not out.exists() or (out.is_dir() and not any(out.iterdir())):
        return
    if not (out / LIST).is_file() or not (out / "times.txt").is_file():
        raise SequenceError(f"{out}: holds something that is no converted recording: choose another folder")
    if not overwrite:
        raise SequenceError(f"{out}: a converted recording is there already: give --overwrite, or another folder")
