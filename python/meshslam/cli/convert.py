"""`meshslam convert`."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshslam.cli.convert_recording import convert_recording
from meshslam.cli.options import Classes, takes_recording

if TYPE_CHECKING:
    from collections.abc import Callable

    from meshslam.perception import DetectionSet, ImageFrames
    from meshslam.sequences import Sequence


class YoloShape(StrEnum):
    """What lines of YOLO's text files are."""

    segment = "segment"
    pose = "pose"
    boxes = "boxes"


class Source(StrEnum):
    """What can be converted."""

    recording = "recording"
    coco = "coco"
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
            help="The recording; or the detections: a file (coco, coco-results, mots-txt) or folder (yolo, openpifpaf, "
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
        typer.Option(help="Names of class numbers, but for openpifpaf: a file (Ultralytics' data.yaml), or car,truck."),
    ] = None,
    classes: Classes = None,
    yolo: Annotated[
        YoloShape | None, typer.Option(help="yolo: what lines are, where they do not tell; boxes become masks.")
    ] = None,
    tracked: Annotated[
        bool | None, typer.Option("--tracked/--no-tracked", help="yolo: whether lines end in a track's number.")
    ] = None,
    video: Annotated[str | None, typer.Option(help="coco: which of the file's videos the recording is.")] = None,
    first_frame: Annotated[
        int | None, typer.Option(help="Number that the files give to the recording's first frame, such as 1.")
    ] = None,
    overwrite: Annotated[bool, typer.Option(help="recording: replace a folder that was written so before.")] = False,
    *,
    recording: Any,  # noqa: ANN401 # settings of `input`
) -> None:
    """Convert a recording to a sequence folder, or detections of other tools to a file for `meshslam map --detections`.

    Example: meshslam convert recording drive.bag drive --topic image=/camera/image_raw

    Example: meshslam convert coco instances.json --sequence drive --out detections.json --classes vehicle=car

    Example: meshslam convert coco-results results.json --sequence drive --out detections.json --names car,truck

    Example: meshslam convert yolo runs/segment/labels --sequence drive --out detections.json --first-frame 1

    Example: meshslam convert mots-txt instances_txt/0006.txt --sequence 06 --out detections.json

    Example: meshslam convert mots-png instances/0006 --sequence 06 --out detections.json --names car,person

    Example: meshslam convert openpifpaf predictions --masks masks.json --sequence drive --out detections.json
    """
    from meshslam.errors import DetectionError, SequenceError

    place = folder or out
    if source is Source.recording:
        if place is None or sequence is not None:
            raise SequenceError(
                "convert recording takes the recording and the folder to write: meshslam convert recording IN OUT"
            )
        convert_recording(_opened(path, recording), place, overwrite=overwrite)
        return
    if place is None or sequence is None:
        raise DetectionError(f"convert {source}: give --sequence, the recording, and --out, the file to write")
    told = _Told(masks, names, classes, yolo, tracked, video, first_frame)
    _convert_detections(source, path, _opened(sequence, recording), place, told)


@dataclass(frozen=True)
class _Told:
    """What the user says of detections."""

    masks: Path | None
    names: str | None
    classes: str | None
    yolo: YoloShape | None
    tracked: bool | None
    video: str | None
    first_frame: int | None


def _opened(path: Path, recording: dict[str, Any]) -> Sequence:
    from meshslam.cli.progress import progress_bars
    from meshslam.runs import InputConfig, open_input, overlaid

    given = {"sequence": path, **recording}
    values = {key: str(value) if isinstance(value, Path) else value for key, value in given.items()}
    with progress_bars() as bars:
        return open_input(overlaid(InputConfig(), values, "flags"), progress=bars)


def _convert_detections(source: Source, path: Path, recording: Sequence, out: Path, told: _Told) -> None:
    """Read them as their tool writes them, and write them as COCO."""
    import sys
    from functools import partial

    from meshslam.cli.options import class_list
    from meshslam.errors import DetectionError
    from meshslam.maps import write_atomically
    from meshslam.perception import (
        ImageFrames,
        counted_from_one,
        from_coco,
        from_coco_results,
        from_mots_png,
        from_mots_txt,
        from_yolo_txt,
        read_class_names,
        read_detections,
        renamed_set,
        renamings,
        with_openpifpaf,
        write_detections,
    )

    for_yolo = {"--yolo": told.yolo, "--tracked": told.tracked}
    unused = [flag for flag, value in for_yolo.items() if value is not None and source is not Source.yolo]
    unused += ["--names"] if told.names is not None and source is Source.openpifpaf else []
    unused += ["--masks"] if told.masks is not None and source is not Source.openpifpaf else []
    unused += ["--video"] if told.video is not None and source is not Source.coco else []
    if unused:
        raise DetectionError(f"{unused[0]}: {source} does not use it: leave it out")
    raw = recording.raw_camera
    frames = ImageFrames(recording.frame_ids, raw.width, raw.height, told.first_frame)
    if source is Source.openpifpaf:
        if told.masks is None:
            raise DetectionError("openpifpaf has key points but no masks: give --masks FILE (meshslam detect makes it)")
        given = read_detections(told.masks)
        if given.undistorted:
            raise DetectionError(f"{told.masks}: its pixels are undistorted, those of openpifpaf are the raw images'")
        found = with_openpifpaf(path, given, frames.shift)
    else:
        table = None if told.names is None else read_class_names(told.names)
        if table is not None and source is Source.coco_results and "=" not in str(told.names):
            table = counted_from_one(path, table)
        readers: dict[Source, Callable[[Path, ImageFrames], DetectionSet]] = {
            Source.coco: lambda path, frames: from_coco(path, recording, frames, table, told.video),
            Source.coco_results: partial(from_coco_results, names=table),
            Source.yolo: partial(
                from_yolo_txt, names=table, shape=None if told.yolo is None else told.yolo.value, tracked=told.tracked
            ),
            Source.mots_txt: partial(from_mots_txt, names=table),
            Source.mots_png: partial(from_mots_png, names=table),
        }
        found = readers[source](path, frames)
    if told.classes is not None:
        found = renamed_set(found, renamings(class_list(told.classes)), str(path))
    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(out, write_detections(found))
    for note in found.warnings:
        print(f"note: {note}", file=sys.stderr)
    print(f"{out}: {len(found.detections)} detections in {len(found.images)} frames")
