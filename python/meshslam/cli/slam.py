"""`meshslam slam`."""

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
def slam(
    sequence: SequenceFolder = None,
    out: RunFolder = Path("run"),
    segmenter: Segmenter = None,
    adapter: Adapter = None,
    classes: Classes = None,
    detections: Detections = None,
    category: CategoryName = None,
    keypoints: Keypoints = None,
    poses: Annotated[
        str | None,
        typer.Option(
            help="none, or odometry: known poses tell each step, with noise, instead of the IMU; or a file of poses."
        ),
    ] = None,
    solver: Annotated[
        str | None, typer.Option(help="smoother, or gradient: the paper's joint problem, by gradient descent.")
    ] = None,
    live: Annotated[
        bool,
        typer.Option(
            "--live",
            help="Replay the recording by its clock, so that every frame has its pose in time, as on a robot; --rate 2 "
            "is then twice as fast.",
        ),
    ] = False,
    config: ConfigFile = None,
    frames_in_report: FramesInReport = None,
    overwrite: Overwrite = False,
    json: AsJson = False,
    *,
    recording: Any,  # noqa: ANN401 # settings of `input`
    viewers: Viewers,
) -> None:
    """Find camera path and cars together, from detections and IMU, or from images alone; poses are not needed.

    Exit code 3: no object was mapped; left_out.json and a note say why.

    Example: meshslam slam drive --out run

    Live: meshslam slam drive --segmenter yolov5n-seg.onnx --live --out run
    """
    check_inputs(config, sequence)
    from meshslam.cli.figures import end_without, show_figures
    from meshslam.cli.progress import run_outlet
    from meshslam.runs import Clock, overlaid, read_config, run_slam

    settings = read_config(config, "slam")
    if live or settings.live.enabled:  # a folder's rate is then given by the configuration only
        rate = recording.pop("rate_hz", settings.live.rate)
        settings = overlaid(settings, {"live": {"enabled": True, "rate": rate}}, "--live --rate")
    settings = with_input(
        settings,
        sequence=sequence,
        **recording,
        segmenter=segmenter,
        adapter=adapter,
        category_names=classes,
        detections=detections,
        category=category,
    )
    settings = with_keypoint_network(settings, keypoints)
    if poses is not None:
        known = poses in ("none", "odometry") or not Path(poses).exists()
        settings = (
            overlaid(settings, {"slam": {"poses": poses}}, "--poses")
            if known
            else with_input(settings, poses=Path(poses))
        )
    if solver is not None:
        settings = overlaid(settings, {"slam": {"solver": solver}}, "--solver")
    with viewers.opened(out, overwrite=overwrite) as log:
        with run_outlet(log, frames_in_report) as outlet:
            figures = run_slam(settings, out, outlet, overwrite=overwrite, clock=Clock.of_process())
        show_figures(figures, out, as_json=json)
    end_without(figures["objects_mapped"])
