"""Find the camera in a map of meshes, without knowing any of its poses: from IMU samples and detections.

Without arguments it draws a street, maps it on a first drive, and localizes a second. For a drive of your own:
python examples/localize_in_a_map.py DRIVE --map RUN --segmenter yolov5n-seg.onnx
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

import meshslam
from meshslam.categories import load_category
from meshslam.simulation import StreetConfig, driven_again, make_street, write_recording

SIZE = {"width_px": 480, "height_px": 150, "focal_px": 285.0}
STREET = StreetConfig(frames=12, cars_each_side=2, moving_cars=0, mode="contrast", **SIZE)


def main() -> None:
    """Localize, print the path, compare it with the truth where there is one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("drive", nargs="?", help="folder of a recording with an IMU; drawn if it is not given")
    parser.add_argument("--map", help="a run, its map.json, or an objects.json")
    parser.add_argument("--segmenter", help="ONNX file of a segmentation network; else the recording's own detections")
    options = parser.parse_args()
    if (options.drive is None) != (options.map is None):
        parser.error("give both a drive and its --map, or neither")

    with tempfile.TemporaryDirectory() as folder:
        drive, scene = options.drive, options.map
        if drive is None:
            first, drive, scene = (Path(folder) / name for name in ("first", "second", "map"))
            street = make_street(load_category("car"), seed=1, config=STREET)
            write_recording(street, first)
            write_recording(driven_again(street, STREET), drive, known_poses=False)
            meshslam.map_drive(first).map.save(scene)

        result = meshslam.localize(drive, scene, segmenter=options.segmenter)

        for time_s, (x, y, z) in zip(result.trajectory.times_s, result.trajectory.positions_in_world, strict=True):
            print(f"{time_s:.1f} s: camera at ({x:.2f}, {y:.2f}, {z:.2f}) m")
        if Path(drive, "groundtruth.tum").exists():
            truth = meshslam.Trajectory.load(Path(drive, "groundtruth.tum")).positions_in_world
            for name, path in {"by the map": result.trajectory, "by the IMU alone": result.inertial}.items():
                error = np.linalg.norm(path.positions_in_world - truth, axis=1)
                print(f"position error {name}: {error.max():.3f} m at most")


if __name__ == "__main__":
    main()
