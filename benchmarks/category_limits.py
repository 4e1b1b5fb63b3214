"""How well the category `car` can reconstruct real cars: its template at best, its modes alone, its mean mesh.

    .venv/bin/python benchmarks/category_limits.py [--category NAME or FILE]

Each CAD is given whole, so nothing here is about what cameras see. Needs the shared data ($MESHSLAM_DATA, or
../shared/data). The family is chosen on the cars of even number, by file name; those of odd number are held out.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import numpy as np
import trimesh

from meshslam.categories import Category, load_category
from meshslam.categories.mesh_solid import MeshSolid
from meshslam.categories.procedural.solid import distance_and_normal
from meshslam.categories.shrinkwrap import Wrapper
from meshslam.categories.spheres import icosphere
from meshslam.geometry import voxel_iou

DATA = Path(os.environ.get("MESHSLAM_DATA", Path(__file__).resolve().parent.parent.parent / "shared" / "data"))
STEP_M = 0.05  # of the independent scorer
PRIOR_M = 0.01  # how far off the surface weighs as much as one sigma of a mode: keeps z within the family


def mode_fit(category: Category, wrapper: Wrapper, solid: MeshSolid) -> tuple[np.ndarray, np.ndarray]:
    """z (M,) and vertices (V, 3) of the modes, free in place, that lie nearest to the solid: Gauss-Newton."""
    corners, kinds = wrapper.samples

    def at(v: np.ndarray) -> np.ndarray:
        return (v[..., corners, :] * kinds[:, :, None]).sum(-2)

    modes, z = at(category.modes), np.zeros(len(category.modes))
    shift = (solid.vertices.min(0) + solid.vertices.max(0)) / 2
    for _ in range(25):
        vertices = category.shape(z) + shift
        distance, normal = distance_and_normal(solid.field, at(vertices))
        share = wrapper.sample_areas(vertices)
        jacobian = np.hstack([np.einsum("msk,sk->sm", modes, normal), normal])
        root = np.sqrt(share / share.sum())[:, None] / PRIOR_M
        free = np.diag(np.r_[np.full(len(z), 0.1), np.zeros(3)])
        rows = np.vstack([root * jacobian, free])
        right = np.concatenate([-root[:, 0] * np.clip(distance, -0.3, 0.3), -0.1 * z, np.zeros(3)])
        step = np.linalg.lstsq(rows, right, rcond=None)[0]
        z, shift = z + step[: len(z)], shift + step[len(z) :]
    return z, category.shape(z) + shift


def iou(vertices: np.ndarray, faces: np.ndarray, cad: trimesh.Trimesh) -> float:
    return voxel_iou(vertices, faces, np.asarray(cad.vertices), np.asarray(cad.faces), STEP_M)


def measure(category: Category, path: Path, wrapper: Wrapper) -> tuple[float, float, float, float]:
    """Voxel IoU of the mean mesh, the modes and the free form; the norm of z over the square root of its length."""
    cad = trimesh.load(path, process=False)
    solid = MeshSolid(np.asarray(cad.vertices), np.asarray(cad.faces))
    z, from_modes = mode_fit(category, wrapper, solid)
    free = wrapper.fit(solid.field, from_modes, smoothness=0.02, anchor=0.002, iterations=10)
    centre = cad.bounds.mean(0)
    rms = float(np.sqrt((z**2).mean()))
    return (
        iou(category.vertices + centre, category.faces, cad),
        iou(from_modes, category.faces, cad),
        iou(free, category.faces, cad),
        rms,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--category", default="car")
    category = load_category(parser.parse_args().category)
    wrapper = Wrapper(icosphere(3))
    paths = sorted((DATA / "cars").glob("*.ply"))
    rows = []
    for path in paths:
        rows.append(measure(category, path, wrapper))
        print(f"{path.stem:28}" + "".join(f"{x:8.3f}" for x in rows[-1]), flush=True)
    table = np.array(rows)
    print("\n| cars | mean mesh | modes | modes, worst | free form | free form, worst |")
    print("| --- | --- | --- | --- | --- | --- |")
    for name, part in (("all", table), ("even", table[::2]), ("odd", table[1::2])):
        mean, least = part.mean(0), part.min(0)
        figures = (mean[0], mean[1], least[1], mean[2], least[2])
        print(f"| {len(part)} ({name}) | " + " | ".join(f"{x:.3f}" for x in figures) + " |")


if __name__ == "__main__":
    main()
