"""A sphere becomes the object that 20 silhouettes show: PyTorch's Adam over every vertex by the exact gradient, no GPU.

Your own: python examples/fit_a_sphere.py FOLDER, with camera.yaml, poses.tum and masks/*.png; else a car is drawn.
"""

import argparse
import time
from pathlib import Path

import cv2
import numpy as np

import meshslam
from meshslam.categories import icosphere, load_category
from meshslam.geometry import Camera, Pose, render, voxel_iou
from meshslam.sequences import read_camera_file


def fit(masks, camera: Camera, world_from_camera: list[Pose], radius_m: float = 1.5, steps: int = 300):
    """Vertices (642, 3) and faces (1280, 3) of a sphere that was moved onto masks (n, h, w); and the mean IoU."""
    import torch

    from meshslam.autodiff.torch import mask_iou_loss

    ball, views = icosphere(3), torch.tensor(np.stack([pose.inverse().matrix for pose in world_from_camera]))
    vertices, faces = torch.tensor(radius_m * ball.vertices, requires_grad=True), torch.tensor(ball.faces)
    first, second = torch.cat([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).T  # every edge, both ways
    seen, degree = torch.tensor(np.stack(masks) > 0), torch.bincount(first)[:, None]
    adam = torch.optim.Adam([vertices], lr=0.02)
    for _ in range(steps):
        loss = mask_iou_loss(vertices, faces, views, camera, seen).mean()
        roughness = torch.zeros_like(vertices).index_add(0, first, vertices[second]) / degree - vertices
        (vertices.grad,) = torch.autograd.grad(loss + 2.0 * roughness.square().sum(1).mean(), vertices)
        adam.step()
    return vertices.detach().numpy(), ball.faces, -loss.item()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, help="camera.yaml, poses.tum, masks/*.png; drawn if not given")
    folder, car = parser.parse_args().folder, load_category("car")
    if folder:
        camera = read_camera_file(folder / "camera.yaml").camera
        poses = meshslam.Trajectory.load(folder / "poses.tum").world_from_camera
        masks = [cv2.imread(str(f), cv2.IMREAD_GRAYSCALE) for f in sorted((folder / "masks").glob("*.png"))]
    else:
        camera, ahead = Camera(128, 128, 220.0, 220.0, 63.5, 63.5), np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
        back = [Pose(ahead, np.array([-9.0, 0.0, k % 4 / 2])) for k in range(20)]
        poses = [Pose.from_yaw(0.314 * k, np.zeros(3)) @ pose for k, pose in enumerate(back)]
        masks = [render(camera, [(pose.inverse(), car.vertices, car.faces)]).mask for pose in poses]
    began = time.perf_counter()
    vertices, faces, overlap = fit(masks, camera, poses)
    print(f"mask IoU {overlap:.3f} in {len(masks)} views after 300 steps in {time.perf_counter() - began:.2f} s")
    if not folder:
        print(f"voxel IoU with the true mesh {voxel_iou(vertices, faces, car.vertices, car.faces):.3f}")


if __name__ == "__main__":
    main()
