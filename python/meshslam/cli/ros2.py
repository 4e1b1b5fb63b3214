"""`meshslam ros2`."""

from __future__ import annotations

import os
import sys
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

ROS_ARGUMENTS = "ros_arguments"


class RosCommand(TyperCommand):
    """A command whose arguments from `--ros-args` on, up to `--` if it is there, are ROS' own."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 # click's
        """Keep ROS' arguments apart."""
        begin = args.index("--ros-args") if "--ros-args" in args else len(args)
        end = args.index("--", begin) if "--" in args[begin:] else len(args)
        ctx.meta[ROS_ARGUMENTS] = args[begin:end]
        return super().parse_args(ctx, [*args[:begin], *args[end + 1 :]])


def ros2(
    context: typer.Context,
    image: Annotated[str, typer.Option(help="Topic of the images: Image or CompressedImage.")] = "/camera/image_raw",
    imu: Annotated[str, typer.Option(help="Topic of the IMU; without one, images alone tell the motion.")] = "",
    camera_info: Annotated[str, typer.Option(help="Topic of CameraInfo; beside the images if not given.")] = "",
    camera: Annotated[str, typer.Option(help="Calibration file of the camera, instead of a topic.")] = "",
    imu_from_camera: Annotated[str, typer.Option(help="Extrinsics: 4x4 in YAML or JSON, or Kalibr's.")] = "",
    imu_time_offset: Annotated[float, typer.Option(help="Seconds by which the IMU's clock is ahead.")] = 0.0,
    camera_from_body: Annotated[
        str, typer.Option(help="File with camera_from_body (4x4): poses are base_link's, not the camera's.")
    ] = "",
    height: Annotated[float, typer.Option(help="Metres from the ground to the camera; 0: not known.")] = 0.0,
    segmenter: Annotated[
        str, typer.Option(help="ONNX file, a name in `meshslam models list`, or colour: a simulated world's.")
    ] = "",
    adapter: Annotated[str, typer.Option(help="How the network is fed and read (YAML).")] = "",
    classes: Annotated[str, typer.Option(help="Classes that are others of ours: vehicle=car.")] = "",
    category: Annotated[str, typer.Option(help="Category to map: a shipped one, or a file (.npz).")] = "car",
    keypoints: Annotated[bool, typer.Option(help="Key points of cars, by the shipped network.")] = True,
    config: Annotated[str, typer.Option(help="YAML file with settings, such as a run's config.yaml.")] = "",
    map: Annotated[str, typer.Option(help="A run to localize in, or its map.json; without it: SLAM.")] = "",
    out: Annotated[str, typer.Option(help="Run directory that map and path are saved to.")] = "run",
    overwrite: Annotated[bool, typer.Option(help="Replace the run that is in it.")] = False,
) -> None:
    """Run as a ROS 2 node: images, camera info and IMU in, odometry, path and a mesh for each car out (docs/ros2.md).

    Needs the extra ros2, or a sourced ROS 2. Every option is a ROS parameter, too: `--ros-args -p image:=/cam0/image`.
    SIGTERM and Ctrl-C save the map.

    Example: meshslam ros2 --image /camera/image_raw --imu /imu --imu-from-camera mounting.yaml
    """
    from meshslam.ros2 import NodeOptions, run_node

    options = NodeOptions(
        image=image,
        imu=imu,
        camera_info=camera_info,
        camera=camera,
        imu_from_camera=imu_from_camera,
        imu_time_offset_s=imu_time_offset,
        camera_from_body=camera_from_body,
        height_above_ground_m=height,
        segmenter=segmenter,
        adapter=adapter,
        classes=classes,
        category=category,
        keypoints=keypoints,
        config=config,
        map=map,
        out=out,
        overwrite=overwrite,
    )
    is_done = run_node(options, context.meta[ROS_ARGUMENTS])
    if not is_done:
        sys.stdout.flush()
        os._exit(130)  # a thread is in the middle of native code
