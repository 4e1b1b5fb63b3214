"""A category of your own from meshes, used to reconstruct an object from masks.

Without arguments it makes a waste bin with Trimesh. For meshes of your own (any format that Trimesh reads):
python examples/own_category.py chair1.obj chair2.stl --name chair --forward -z --up y --scale 0.001
Then: meshslam map DRIVE --category chair.npz, or meshslam.map_drive(DRIVE, category="chair.npz")
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
import trimesh

from meshslam.categories import MeshOptions, category_from_meshes, save_category
from meshslam.geometry import Camera, Pose, render, voxel_iou
from meshslam.mapping import object_from_masks


def bin_mesh(length_m: float, width_m: float, height_m: float) -> trimesh.Trimesh:
    """A body that is narrower below, x forward and z up, with a sloping lid."""
    corners = np.array([(x, y, z) for z in (0, 1) for x in (-0.5, 0.5) for y in (-0.5, 0.5)], float)
    corners[:4, :2] *= 0.75
    corners[corners[:, 2] > 0, 2] += 0.12 * (corners[corners[:, 2] > 0, 0] < 0)  # the lid is higher at the rear
    return trimesh.convex.convex_hull(corners * [length_m, width_m, height_m])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", nargs="*", type=Path, help="mesh files; a waste bin is made if none is given")
    parser.add_argument("--name", default="bin", help="what detections call the class")
    parser.add_argument("--forward", default="x", help="axis of the files that points ahead: x, -x, y, -y, z, -z")
    parser.add_argument("--up", default="z", help="axis that points up")
    parser.add_argument("--scale", type=float, default=1.0, help="unit of the files in metres")
    parser.add_argument("--out", help="file for the category (.npz)")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        meshes, file = options.meshes, Path(options.out or f"{folder}/{options.name}.npz")
        if not meshes:  # one is enough; more would tell how shapes differ
            meshes = [Path(folder, "bin.ply")]
            bin_mesh(1.2, 1.0, 1.3).export(meshes[0])
        axes = MeshOptions(forward=options.forward, up=options.up, scale=options.scale)
        category, notes = category_from_meshes(options.name, meshes, options=axes)
        print(*notes, sep="\n", end="\n" if notes else "")
        save_category(category, file)  # load_category(file) reads it
    size, modes = np.round(category.dimensions, 2), len(category.modes)
    print(f"{category.name}: {len(category.vertices)} vertices, {modes} modes, mean size {size} m")

    truth, camera, poses = category.shape(np.array([1.0, -0.7])), Camera(320, 240, 300.0, 300.0, 159.5, 119.5), []
    for angle in np.arange(6) * 1.1:  # around the object, looking at it: the camera's z is ahead, its y down
        ahead, right = -np.array([np.cos(angle), np.sin(angle), 0]), np.array([-np.sin(angle), np.cos(angle), 0])
        poses.append(Pose(np.column_stack([right, [0, 0, -1], ahead]), -2.5 * np.ptp(truth, axis=0).max() * ahead))
    masks = [render(camera, [(pose.inverse(), truth, category.faces)]).mask for pose in poses]
    found = object_from_masks(masks, poses, camera, category)
    print(f"voxel IoU {voxel_iou(found.vertices_in_world, found.faces, truth, category.faces, step_m=0.02):.3f}")


if __name__ == "__main__":
    main()
