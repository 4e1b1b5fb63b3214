"""`meshslam detect`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer


def detect(
    sequence: Annotated[Path, typer.Argument(help="Folder of the recording.")],
    out: Annotated[Path, typer.Option(help="Where to write the detections (JSON, COCO).")],
    segmenter: Annotated[str | None, typer.Option(help="ONNX file, or a name in `meshslam models list`.")] = None,
    layout: Annotated[str | None, typer.Option(help="Name of the layout, where the path does not tell.")] = None,
    camera: Annotated[int | None, typer.Option(help="Which of the layout's cameras.")] = None,
    keypoints: Annotated[
        bool | None, typer.Option("--keypoints/--no-keypoints", help="Key points of cars, by the shipped network.")
    ] = None,
    config: Annotated[Path | None, typer.Option(help="YAML file with settings.")] = None,
) -> None:
    """Segment every frame of a recording and write the detections.

    Example: meshslam detect 2011_09_26_drive_0048_sync --segmenter yolov5n-seg.onnx --out detections.json
    """
    from meshslam.cli.config import read_config
    from meshslam.cli.progress import progress_bars
    from meshslam.cli.stages import open_input, segment_frames, with_keypoints
    from meshslam.maps import write_atomically
    from meshslam.perception import write_detections

    settings = read_config(config)
    chosen = replace(
        settings.input, sequence=str(sequence), layout=layout, camera=camera, segmenter=segmenter, detections=None
    )
    settings = replace(settings, input=chosen)
    if keypoints is not None:
        settings = replace(settings, keypoints=replace(settings.keypoints, enabled=keypoints))
    recording = open_input(settings.input)
    with progress_bars() as bars:
        found = with_keypoints(recording, segment_frames(recording, settings, bars), settings, bars)
    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(out, write_detections(found))
    print(f"{out}: {len(found.detections)} detections in {len(found.images)} frames")
