"""`meshslam convert`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshslam.cli.options import takes_recording

if TYPE_CHECKING:
    from collections.abc import Callable

    from meshslam.perception import DetectionSet, ImageFrames
    from meshslam.sequences import Sequence


class Source(StrEnum):
    """What can be converted."""

    recording = "recording"
    coco_results = "coco-results"
    yolo = "yolo"
    openpifpaf = "openpifpaf"
    mots_txt = "mots-txt"
    mots_png = "mots-png"


@takes_recording
def convert(
    source: Annotated[Source, typer.Argument(help="What it is: a recording, or whose detections.")],
    path: Annotated[
        Path,
        typer.Argument(
            help="The recording; or the detections: a file (coco-results, mots-txt) or folder (yolo, openpifpaf, "
            "mots-png)."
        ),
    ],
    folder: Annotated[Path | None, typer.Argument(help="recording: the sequence folder to write.")] = None,
    sequence: Annotated[
        Path | None, typer.Option(help="Detections: the recording that they are of: its frames and its images' size.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Where to write: the detections (JSON, COCO), or the sequence folder.")
    ] = None,
    masks: Annotated[Path | None, typer.Option(help="openpifpaf: detections with masks, which get the points.")] = None,
    names: Annotated[
        str | None,
        typer.Option(
            help="yolo, coco-results: names of the class numbers: a file such as Ultralytics' data.yaml, or car,truck."
        ),
    ] = None,
    first_frame: Annotated[
        int | None, typer.Option(help="Number that the files give to the recording's first frame, such as 1.")
    ] = None,
    overwrite: Annotated[bool, typer.Option(help="recording: replace a folder that was written so before.")] = False,
    *,
    recording: Any,  # noqa: ANN401 # settings of `input`
) -> None:
    """Convert a recording to a sequence folder, or detections of other tools to a file for `meshslam map --detections`.

    Example: meshslam convert recording drive.bag drive --topic image=/camera/image_raw

    Example: meshslam convert mots-txt 0006.txt --sequence 06 --out detections.json
    """
    from meshslam.errors import DetectionError, SequenceError

    place = folder or out
    if source is Source.recording:
        if place is None or sequence is not None:
            raise SequenceError(
                "convert recording takes the recording and the folder to write: meshslam convert recording IN OUT"
            )
        _convert_recording(_opened(path, recording), place, overwrite=overwrite)
        return
    if place is None or sequence is None:
        raise DetectionError(f"convert {source}: give --sequence, the recording, and --out, the file to write")
    _convert_detections(source, path, _opened(sequence, recording), place, masks, names, first_frame)


def _opened(path: Path, recording: dict[str, Any]) -> Sequence:
    from meshslam.runs import InputConfig, open_input, overlaid

    given = {"sequence": path, **recording}
    values = {key: str(value) if isinstance(value, Path) else value for key, value in given.items()}
    return open_input(overlaid(InputConfig(), values, "flags"))


def _convert_recording(recording: Sequence, out: Path, *, overwrite: bool) -> None:
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


def _convert_detections(
    source: Source,
    path: Path,
    recording: Sequence,
    out: Path,
    masks: Path | None,
    names: str | None,
    first_frame: int | None,
) -> None:
    """Read them as their tool writes them, and write them as COCO."""
    import sys
    from functools import partial

    from meshslam.errors import DetectionError
    from meshslam.maps import write_atomically
    from meshslam.perception import (
        ImageFrames,
        counted_from_one,
        from_coco_results,
        from_mots_png,
        from_mots_txt,
        from_yolo_txt,
        read_class_names,
        read_detections,
        with_openpifpaf,
        write_detections,
    )

    raw = recording.raw_camera
    frames = ImageFrames(recording.frame_ids, raw.width, raw.height, first_frame)
    if source is Source.openpifpaf:
        if masks is None:
            raise DetectionError("openpifpaf has key points but no masks: give --masks FILE (meshslam detect makes it)")
        found = with_openpifpaf(path, read_detections(masks), frames.shift)
    else:
        table = None if names is None else read_class_names(names)
        if table is not None and source in (Source.mots_txt, Source.mots_png):
            raise DetectionError(f"--names: {source} has classes of its own: leave it out")
        if table is not None and source is Source.coco_results and "=" not in str(names):
            table = counted_from_one(path, table)
        readers: dict[Source, Callable[[Path, ImageFrames], DetectionSet]] = {
            Source.coco_results: partial(from_coco_results, names=table),
            Source.yolo: partial(from_yolo_txt, names=table),
            Source.mots_txt: from_mots_txt,
            Source.mots_png: from_mots_png,
        }
        found = readers[source](path, frames)
    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(out, write_detections(found))
    for note in found.warnings:
        print(f"note: {note}", file=sys.stderr)
    print(f"{out}: {len(found.detections)} detections in {len(found.images)} frames")
