"""`meshslam slam`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from meshslam.cli.options import (
    Adapter,
    AsJson,
    CameraFromBody,
    CameraNumber,
    Classes,
    ConfigFile,
    Detections,
    Extrinsics,
    ImuFile,
    Keypoints,
    Layout,
    Overwrite,
    PosesConvention,
    RunFolder,
    Segmenter,
    SequenceFolder,
    with_input,
    with_keypoint_network,
)


def slam(
    sequence: SequenceFolder = None,
    out: RunFolder = Path("run"),
    imu: ImuFile = None,
    imu_from_camera: Extrinsics = None,
    segmenter: Segmenter = None,
    adapter: Adapter = None,
    classes: Classes = None,
    detections: Detections = None,
    layout: Layout = None,
    camera: CameraNumber = None,
    poses_convention: PosesConvention = None,
    camera_from_body: CameraFromBody = None,
    keypoints: Keypoints = None,
    poses: Annotated[
        str | None, typer.Option(help="none, or odometry: known poses tell each step, with noise, instead of the IMU.")
    ] = None,
    solver: Annotated[
        str | None, typer.Option(help="smoother, or gradient: the paper's joint problem, by gradient descent.")
    ] = None,
    config: ConfigFile = None,
    overwrite: Overwrite = False,
    json: AsJson = False,
) -> None:
    """Find camera path and cars together, from detections and IMU, or from images alone; poses are not needed.

    Exit code 3: no object was mapped; left_out.json and a note say why.

    Example: meshslam slam drive --out run
    """
    from meshslam.cli.figures import end_without, show_figures
    from meshslam.cli.progress import run_outlet
    from meshslam.runs import overlaid, read_config, run_slam

    settings = with_input(
        read_config(config, "slam"),
        sequence=sequence,
        imu=imu,
        imu_from_camera=imu_from_camera,
        segmenter=segmenter,
        adapter=adapter,
        category_names=classes,
        detections=detections,
        layout=layout,
        camera=camera,
        poses_convention=poses_convention,
        camera_from_body=camera_from_body,
    )
    settings = with_keypoint_network(settings, keypoints)
    if poses is not None:
        settings = overlaid(settings, {"slam": {"poses": poses}}, "--poses")
    if solver is not None:
        settings = overlaid(settings, {"slam": {"solver": solver}}, "--solver")
    with run_outlet() as outlet:
        figures = run_slam(settings, out, outlet, overwrite=overwrite)
    show_figures(figures, out, as_json=json)
    end_without(figures["objects_mapped"])
