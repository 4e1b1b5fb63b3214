"""`meshslam map`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from meshslam.cli.options import (
    Adapter,
    AsJson,
    CategoryName,
    Classes,
    ConfigFile,
    Detections,
    FramesInReport,
    Keypoints,
    Overwrite,
    RunFolder,
    Segmenter,
    SequenceFolder,
    check_inputs,
    takes_recording,
    with_input,
    with_keypoint_network,
)
from meshslam.cli.viewers import Viewers, takes_viewers


@takes_viewers
@takes_recording
def map_(
    sequence: SequenceFolder = None,
    out: RunFolder = Path("run"),
    segmenter: Segmenter = None,
    adapter: Adapter = None,
    classes: Classes = None,
    detections: Detections = None,
    category: CategoryName = None,
    tracker: Annotated[str | None, typer.Option(help="hungarian, or paper: greedy, tracks that are lost end.")] = None,
    solver: Annotated[
        str | None, typer.Option(help="residuals: second order on the outline; gradient: the paper's descent.")
    ] = None,
    keypoints: Keypoints = None,
    config: ConfigFile = None,
    frames_in_report: FramesInReport = None,
    overwrite: Overwrite = False,
    json: AsJson = False,
    *,
    recording: Any,  # noqa: ANN401 # settings of `input`
    viewers: Viewers,
) -> None:
    """Map a recording with known camera poses: every parked car with its pose and its own mesh.

    Exit code 3: no object was mapped; left_out.json and a note say why.

    Example: meshslam map 2011_09_26_drive_0048_sync --segmenter yolov5n-seg.onnx --out run48
    """
    check_inputs(config, sequence)
    from meshslam.cli.figures import end_without, show_figures
    from meshslam.cli.progress import run_outlet
    from meshslam.runs import Clock, overlaid, read_config, run_map

    settings = with_input(
        read_config(config, "map"),
        sequence=sequence,
        **recording,
        segmenter=segmenter,
        adapter=adapter,
        category_names=classes,
        detections=detections,
        category=category,
    )
    settings = with_keypoint_network(settings, keypoints)
    if tracker is not None:
        settings = overlaid(settings, {"tracking": {"tracker": tracker}}, "--tracker")
    if solver is not None:
        settings = overlaid(settings, {"objects": {"solver": solver}}, "--solver")
    with viewers.opened(out, overwrite=overwrite) as log:
        with run_outlet(log, frames_in_report) as outlet:
            figures = run_map(settings, out, outlet, overwrite=overwrite, clock=Clock.of_process())
        show_figures(figures, out, as_json=json)
    end_without(figures["objects_mapped"])
