"""`meshslam detect`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from meshslam.cli.options import (
    Adapter,
    Classes,
    ConfigFile,
    Keypoints,
    Segmenter,
    check_inputs,
    takes_recording,
    with_input,
    with_keypoint_network,
)


@takes_recording
def detect(
    sequence: Annotated[Path, typer.Argument(help="Folder or file of the recording.")],
    out: Annotated[Path, typer.Option(help="Where to write the detections (JSON, COCO).")],
    segmenter: Segmenter = None,
    adapter: Adapter = None,
    classes: Classes = None,
    keypoints: Keypoints = None,
    config: ConfigFile = None,
    *,
    recording: Any,  # noqa: ANN401 # settings of `input`
) -> None:
    """Segment every frame of a recording and write the detections.

    Example: meshslam detect 2011_09_26_drive_0048_sync --segmenter yolov5n-seg.onnx --out detections.json
    """
    check_inputs(config, sequence)
    from dataclasses import replace

    from meshslam.cli.progress import run_outlet
    from meshslam.maps import write_atomically
    from meshslam.perception import write_detections
    from meshslam.runs import open_input, read_config, segment_frames, with_keypoints

    settings = read_config(config, "detect")
    settings = with_input(
        settings, sequence=sequence, segmenter=segmenter, adapter=adapter, category_names=classes, **recording
    )
    settings = with_keypoint_network(settings, keypoints)
    with run_outlet() as outlet:
        recording = open_input(settings.input, progress=outlet.progress)
        found = with_keypoints(recording, segment_frames(recording, settings, outlet), settings, outlet)
    out.parent.mkdir(parents=True, exist_ok=True)
    found = replace(found, undistorted=recording.distortion is not None)
    write_atomically(out, write_detections(found))
    print(f"{out}: {len(found.detections)} detections in {len(found.images)} frames")
