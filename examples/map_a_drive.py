"""Map a drive with known camera poses: each parked car with its pose and its own mesh.

Without arguments it draws a street and maps it. For a drive of your own:
python examples/map_a_drive.py 2011_09_26_drive_0048_sync --segmenter yolov5n-seg.onnx
"""

import argparse
import tempfile
from pathlib import Path

import meshslam
from meshslam.categories import load_category
from meshslam.simulation import StreetConfig, make_street, write_recording

SIZE = {"width_px": 480, "height_px": 150, "focal_px": 285.0}
STREET = StreetConfig(frames=12, cars_each_side=2, moving_cars=0, mode="contrast", **SIZE)


def main() -> None:
    """Map, print what was found, save it, compare it with the truth where there is one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("drive", nargs="?", help="folder of a recording; a street is drawn if it is not given")
    parser.add_argument("--segmenter", help="ONNX file of a segmentation network; else the recording's own detections")
    parser.add_argument("--out", help="folder for the map; a temporary one if it is not given")
    options = parser.parse_args()

    with tempfile.TemporaryDirectory() as folder:
        drive, segmenter, out = options.drive, options.segmenter, options.out or f"{folder}/map"
        if drive is None:  # `colour` finds the cars by the colours they are drawn in, as a network would
            drive, segmenter = Path(folder) / "street", segmenter or "colour"
            write_recording(make_street(load_category("car"), seed=1, config=STREET), drive)

        result = meshslam.map_drive(drive, segmenter=segmenter)

        for number, car in result.map.items():
            x, y, z = car.world_from_object.translation
            length, width, height = car.dimensions
            print(f"car {number} at ({x:.2f}, {y:.2f}, {z:.2f}) m, {length:.2f} x {width:.2f} x {height:.2f} m")
            print(f"  vertices {car.vertices.shape}, uncertain by {1e3 * max(car.vertex_sigma_m):.0f} mm at most")
        for left in result.left_out:
            print(f"track {left.track} is not in the map: {left.reason}. {left.detail}")

        result.map.save(out)  # map.json and objects/<id>.ply
        result.trajectory.save(f"{out}/trajectory.tum")
        for name, value in meshslam.evaluate(out, drive).items():
            print(f"{name} {value:.3f}")


if __name__ == "__main__":
    main()
