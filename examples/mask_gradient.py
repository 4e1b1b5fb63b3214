"""The mask loss's exact gradient in an optimizer: SciPy moves a mesh until it covers a mask.

Without arguments it moves a car that is 0.5 m and 8 degrees off. For a run of your own:
python examples/mask_gradient.py RUN    # each object of the map, in the frame that shows it largest
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

import meshslam
from meshslam.categories import load_category
from meshslam.geometry import Camera, MaskLoss, Pose, exp_so3, render, right_jacobian
from meshslam.perception import read_detections
from meshslam.sequences import read_camera_file


def moved_onto(mask, camera: Camera, start: Pose, vertices, faces) -> Pose:
    """camera_from_object near `start`, where the mesh covers the mask (h, w) best; the loss is -IoU."""
    loss = MaskLoss(camera, len(vertices), faces, mask)

    def value_and_gradient(step):  # (6,): translation, metres, then rotation, radians
        found = loss.gradient(start.retract(step), vertices)
        turned, jacobian = exp_so3(step[3:]), right_jacobian(step[3:])  # take a right perturbation to the step
        return found.loss, np.concatenate([turned @ found.object[:3], jacobian.T @ found.object[3:]])

    best = minimize(value_and_gradient, np.zeros(6), jac=True, method="L-BFGS-B")
    print(f"IoU {-loss.gradient(start, vertices).loss:.3f}, then {-best.fun:.3f} after {best.nfev} evaluations")
    return start.retract(best.x)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", nargs="?", type=Path, help="run directory; a car is drawn if it is not given")
    run = parser.parse_args().run
    if run is None:
        camera, car = Camera(640, 240, 500.0, 500.0, 319.5, 119.5), load_category("car")
        forward_left_up = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])  # seen from behind
        truth = Pose(forward_left_up, np.array([1.5, 0.8, 11.0])) @ Pose.from_yaw(0.5, np.zeros(3))
        mask = render(camera, [(truth, car.vertices, car.faces)]).mask
        start = truth.retract(np.array([0.4, -0.3, 0.1, 0.02, -0.03, 0.14]))
        error = truth.local(moved_onto(mask, camera, start, car.vertices, car.faces))
        metres, radians = np.linalg.norm(error.reshape(2, 3), axis=1)
        print(f"{metres:.3f} m and {np.degrees(radians):.2f} degrees from the truth")
        return
    camera, seen = read_camera_file(run / "camera.yaml").camera, read_detections(run / "detections.json")
    world_from_camera = meshslam.Trajectory.load(run / "trajectory.tum").world_from_camera
    pose_of_frame = dict(zip(seen.by_frame(), world_from_camera, strict=True))
    for number, car in meshslam.Map.load(run).items():
        largest = max(seen.by_track()[number], key=lambda d: d.area_px)
        print(f"object {number}, frame {largest.frame}:", end=" ")
        camera_from_object = pose_of_frame[largest.frame].inverse() @ car.world_from_object
        moved_onto(largest.mask(), camera, camera_from_object, car.vertices, car.faces)


if __name__ == "__main__":
    main()
