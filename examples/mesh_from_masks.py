"""The mesh of one object from its masks and the camera's poses: no recording, no network.

Without arguments it draws a car's masks first. For an object of your own: python examples/mesh_from_masks.py FOLDER
The folder holds camera.yaml, poses.tum (one pose a mask, the world's z up) and masks/*.png (above 0 on the object).
"""

import argparse
from pathlib import Path

import cv2
import numpy as np

import meshslam
from meshslam.categories import load_category
from meshslam.geometry import Camera, Pose, mask_iou, render, voxel_iou
from meshslam.mapping import object_from_masks
from meshslam.sequences import read_camera_file


def draw(camera: Camera, world_from_camera: Pose, world_from_object: Pose, vertices, faces):
    """The mask (h, w) of a mesh in a view."""
    return render(camera, [(world_from_camera.inverse() @ world_from_object, vertices, faces)]).mask


def looking_at_origin(angle_rad: float) -> Pose:
    """A camera 9 m from the origin and 1.5 m above it: x right, y down, z ahead; the world is z up."""
    centre = np.array([9.0 * np.cos(angle_rad), 9.0 * np.sin(angle_rad), 1.5])
    ahead = -centre / np.linalg.norm(centre)
    right = np.cross(ahead, [0.0, 0.0, 1.0]) / np.linalg.norm(ahead[:2])
    return Pose(np.column_stack([right, np.cross(ahead, right), ahead]), centre)


def main() -> None:
    """Reconstruct, print the mesh, draw it again in each view."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", help="camera.yaml, poses.tum, masks/*.png; drawn if it is not given")
    parser.add_argument("--category", default="car", help="a shipped category, or a file (.npz)")
    options = parser.parse_args()
    category = load_category(options.category)
    truth = category.shape(np.random.default_rng(3).normal(size=len(category.modes)))  # (V, 3), a car never seen
    if options.folder is None:
        camera, poses = Camera(480, 320, 450.0, 450.0, 239.5, 159.5), [looking_at_origin(k * 0.7) for k in range(9)]
        masks = [draw(camera, pose, Pose.identity(), truth, category.faces) for pose in poses]
    else:
        camera = read_camera_file(Path(options.folder, "camera.yaml")).camera
        poses = meshslam.Trajectory.load(Path(options.folder, "poses.tum")).world_from_camera
        masks = [cv2.imread(str(f), cv2.IMREAD_GRAYSCALE) for f in sorted(Path(options.folder, "masks").glob("*.png"))]
    car = object_from_masks(masks, poses, camera, category)
    print(f"vertices {car.vertices.shape}, faces {car.faces.shape}, size {car.dimensions.round(2)} m")
    drawn = [draw(camera, pose, car.world_from_object, car.vertices, car.faces) for pose in poses]
    print(f"mask IoU {np.mean([mask_iou(a, b) for a, b in zip(drawn, masks, strict=True)]):.3f}")
    if options.folder is None:
        overlap = voxel_iou(car.vertices_in_world, car.faces, truth, category.faces)
        print(f"voxel IoU with the true mesh {overlap:.3f}")


if __name__ == "__main__":
    main()
