"""The pose of a known mesh from one mask: JAX's Adam from several headings at once, by the exact gradient.

Your own (x forward, z up): python examples/pose_from_a_mask.py MESH.ply MASK.png camera.yaml; else a car is drawn.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np
import trimesh

from meshslam.categories import load_category
from meshslam.geometry import Camera, Pose, render
from meshslam.sequences import read_camera_file

AHEAD = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])  # camera from an object that drives away


def found(mask, camera: Camera, mesh) -> tuple[Pose, float]:
    """camera_from_object that covers the mask (h, w) best, from 12 headings where its height says; and its IoU."""
    import jax
    from jax.example_libraries.optimizers import adam

    from meshslam.autodiff.jax import exp_se3, mask_iou_loss

    rows, columns = np.nonzero(mask)
    depth_m = camera.fy * np.ptp(mesh.vertices[:, 2]) / np.ptp(rows)
    middle = Pose(AHEAD, depth_m * camera.rays(np.array([columns.mean(), rows.mean()])))
    start = np.stack([(middle @ Pose.from_yaw(k * np.pi / 6, np.zeros(3))).matrix for k in range(12)])

    def losses(tangents):  # (12, 6)
        return mask_iou_loss(mesh.vertices, mesh.faces, start @ exp_se3(tangents), camera, mask > 0)

    initial, update, current = adam(0.03)
    state, gradient = initial(np.zeros((12, 6), np.float32)), jax.jit(jax.grad(lambda x: losses(x).sum()))
    for step in range(150):
        state = update(step, gradient(current(state)), state)
    best = losses(current(state)).argmin()
    matrix = np.asarray(start @ exp_se3(current(state)))[best]
    return Pose(matrix[:3, :3], matrix[:3, 3]), -float(losses(current(state))[best])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", help="MESH.ply MASK.png camera.yaml; drawn if they are not given")
    files, car, camera = parser.parse_args().files, load_category("car"), Camera(320, 160, 300.0, 300.0, 159.5, 79.5)
    if files:
        mesh, mask = trimesh.load(files[0], force="mesh", process=False), cv2.imread(files[1], cv2.IMREAD_GRAYSCALE)
        pose, overlap = found(mask, read_camera_file(Path(files[2])).camera, mesh)
        return print(f"IoU {overlap:.3f}, camera_from_object\n{pose.matrix}")
    truth = Pose(AHEAD, np.array([0.8, 0.6, 9.0])) @ Pose.from_yaw(0.6, np.zeros(3))
    pose, overlap = found(render(camera, [(truth, car.vertices, car.faces)]).mask, camera, car)
    metres, radians = np.linalg.norm(truth.local(pose).reshape(2, 3), axis=1)
    print(f"IoU {overlap:.3f}: {metres:.3f} m and {np.degrees(radians):.2f} degrees from the truth")


if __name__ == "__main__":
    main()
