"""`meshslam localize`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from meshslam.cli.options import (
    Adapter,
    AsJson,
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
def localize(
    sequence: SequenceFolder = None,
    map_path: Annotated[Path | None, typer.Option("--map", help="A run, its map.json, or an objects.json.")] = None,
    out: RunFolder = Path("run"),
    allow_outside: Annotated[
        bool, typer.Option("--allow-outside", help="Read meshes outside the map's folder.")
    ] = False,
    segmenter: Segmenter = None,
    adapter: Adapter = None,
    classes: Classes = None,
    detections: Detections = None,
    keypoints: Keypoints = None,
    solver: Annotated[str | None, typer.Option(help="smoother, or gradient: the paper's, pose by pose.")] = None,
    config: ConfigFile = None,
    frames_in_report: FramesInReport = None,
    overwrite: Overwrite = False,
    json: AsJson = False,
    *,
    recording: Any,  # noqa: ANN401 # settings of `input`
    viewers: Viewers,
) -> None:
    """Find the camera of every frame in a map of meshes, by IMU, masks and key points.

    Exit code 3: no detection could be used; left_out.json and a note say why.

    Example: meshslam localize drive2 --map run1 --out run2
    """
    check_inputs(config, sequence, map_path)
    from meshslam.cli.figures import end_without, show_figures
    from meshslam.cli.progress import run_outlet
    from meshslam.runs import Clock, overlaid, read_config, run_localize

    settings = with_input(
        read_config(config, "localize"),
        sequence=sequence,
        **recording,
        map=map_path,
        allow_outside=allow_outside or None,
        segmenter=segmenter,
        adapter=adapter,
        category_names=classes,
        detections=detections,
    )
    settings = with_keypoint_network(settings, keypoints)
    if solver is not None:
        settings = overlaid(settings, {"localization": {"solver": solver}}, "--solver")
    with viewers.opened(out, overwrite=overwrite) as log:
        with run_outlet(log, frames_in_report) as outlet:
            figures = run_localize(settings, out, outlet, overwrite=overwrite, clock=Clock.of_process())
        show_figures(figures, out, as_json=json)
    end_without(figures["views_used"])
