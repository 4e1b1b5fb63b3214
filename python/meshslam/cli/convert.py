"""`meshslam convert`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from meshslam.cli.options import Classes

if TYPE_CHECKING:
    from collections.abc import Callable

    from meshslam.perception import DetectionSet, ImageFrames


class YoloShape(StrEnum):
    """What lines of YOLO's text files are."""

    segment = "segment"
    pose = "pose"
    boxes = "boxes"


class Source(StrEnum):
    """What can be converted."""

    coco = "coco"
    coco_results = "coco-results"
    yolo = "yolo"
    openpifpaf = "openpifpaf"
    mots_txt = "mots-txt"
    mots_png = "mots-png"


def convert(
    source: Annotated[Source, typer.Argument(help="Whose detections they are.")],
    path: Annotated[
        Path, typer.Argument(help="File (coco, coco-results, mots-txt) or folder (yolo, openpifpaf, mots-png).")
    ],
    sequence: Annotated[Path, typer.Option(help="Folder of the recording: its frames and its images' size.")],
    out: Annotated[Path, typer.Option(help="Where to write the detections (JSON, COCO).")],
    masks: Annotated[Path | None, typer.Option(help="openpifpaf: detections with masks, which get the points.")] = None,
    names: Annotated[
        str | None,
        typer.Option(
            help="yolo, coco, coco-results: names of class numbers: a file (Ultralytics' data.yaml), or car,truck."
        ),
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
    layout: Annotated[str | None, typer.Option(help="Name of the layout, where the path does not tell.")] = None,
    camera: Annotated[int | None, typer.Option(help="Which of the layout's cameras.")] = None,
) -> None:
    """Convert detections of other tools to the file that `meshslam map --detections` reads.

    Example: meshslam convert mots-txt 0006.txt --sequence 06 --out detections.json
    """
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
    from meshslam.runs import InputConfig, open_input

    for_yolo = {"--yolo": yolo, "--tracked": tracked}
    unused = [flag for flag, value in for_yolo.items() if value is not None and source is not Source.yolo]
    unused += ["--video"] if video is not None and source is not Source.coco else []
    if unused:
        raise DetectionError(f"{unused[0]}: {source} does not use it: leave it out")
    recording = open_input(InputConfig(sequence=str(sequence), layout=layout, camera=camera))
    raw = recording.raw_camera
    frames = ImageFrames(recording.frame_ids, raw.width, raw.height, first_frame)
    if source is Source.openpifpaf:
        if masks is None:
            raise DetectionError("openpifpaf has key points but no masks: give --masks FILE (meshslam detect makes it)")
        given = read_detections(masks)
        if given.undistorted:
            raise DetectionError(f"{masks}: its pixels are undistorted, those of openpifpaf are the raw images'")
        found = with_openpifpaf(path, given, frames.shift)
    else:
        table = None if names is None else read_class_names(names)
        if table is not None and source in (Source.mots_txt, Source.mots_png):
            raise DetectionError(f"--names: {source} has classes of its own: leave it out")
        if table is not None and source is Source.coco_results and "=" not in str(names):
            table = counted_from_one(path, table)
        readers: dict[Source, Callable[[Path, ImageFrames], DetectionSet]] = {
            Source.coco: lambda path, frames: from_coco(path, recording, frames, table, video),
            Source.coco_results: partial(from_coco_results, names=table),
            Source.yolo: partial(
                from_yolo_txt, names=table, shape=None if yolo is None else yolo.value, tracked=tracked
            ),
            Source.mots_txt: from_mots_txt,
            Source.mots_png: from_mots_png,
        }
        found = readers[source](path, frames)
    if classes is not None:
        found = renamed_set(found, renamings(class_list(classes)), str(path))
    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(out, write_detections(found))
    for note in found.warnings:
        print(f"note: {note}", file=sys.stderr)
    print(f"{out}: {len(found.detections)} detections in {len(found.images)} frames")
