"""SLAM frame by frame: images and IMU samples in, poses and meshes out, saved and loaded in the middle.

Without arguments it draws a street and drives through it. For a drive of your own:
python examples/live_slam.py 06 --segmenter yolov5n-seg.onnx --imu 06.csv --imu-from-camera camera_from_imu.json
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

import meshslam
from meshslam.categories import load_category
from meshslam.simulation import StreetConfig, make_street, write_recording

SIZE = {"width_px": 480, "height_px": 150, "focal_px": 285.0}
STREET = StreetConfig(frames=14, cars_each_side=2, moving_cars=0, mode="contrast", **SIZE)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("drive", nargs="?", help="folder of a recording with images; drawn if it is not given")
    parser.add_argument("--segmenter", help="ONNX file of a segmentation network")
    parser.add_argument("--imu", help="IMU samples (CSV), if they are not in the drive")
    parser.add_argument("--imu-from-camera", help="the IMU's mounting (YAML or JSON)")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if options.drive is None:  # `colour` finds the cars by the colours they are drawn in, as a network would
            options.drive, options.segmenter = f"{folder}/street", options.segmenter or "colour"
            write_recording(make_street(load_category("car"), seed=1, config=STREET), options.drive)
        drive = meshslam.open_sequence(options.drive, imu=options.imu, imu_from_camera=options.imu_from_camera)
        setup = {
            "imu_from_camera": None if drive.imu is None else drive.imu_from_camera,
            "height_above_ground_m": drive.height_above_ground_m,
            "start": drive.initial_state,  # None: it waits for some seconds, and finds pose and speed from them
            "segmenter": options.segmenter,
        }
        slam, last_s = meshslam.Slam(drive.camera, **setup), -np.inf
        for index, time_s in enumerate(drive.times_s):
            samples, last_s = None if drive.imu is None else drive.imu.between(last_s, time_s), time_s
            state = slam.process(image=drive.read_image(index), imu=samples, time_s=time_s)
            where = state.world_from_camera.translation.round(2) if state.is_started else "unknown"
            meshes = {number: car.vertices_in_world for number, car in slam.map().items()}  # (V, 3) each, metres
            print(f"{time_s:.1f} s: camera at {where} m, meshes of cars {sorted(meshes)}")
            if index == len(drive) // 2 and state.is_started:
                slam.save(f"{folder}/state.npz")
                slam = meshslam.Slam.load(f"{folder}/state.npz", drive.camera, **setup)
        result = slam.finish()  # all frames smoothed together, and the meshes fitted along them
        print(f"cars in the map: {sorted(result.map)}")
        if Path(options.drive, "groundtruth.tum").exists():
            result.map.save(folder)
            result.trajectory.save(f"{folder}/trajectory.tum")
            for name, value in meshslam.evaluate(folder, options.drive).items():
                print(f"{name} {value:.3f}")


if __name__ == "__main__":
    main()
