"""The renderer and its gradients beside DEODR's and OpenCV's: one car in one view; then threads, sizes and views.

    .venv/bin/python benchmarks/render.py [--quick]

Writes benchmarks/out/render.json (one view beside DEODR: minima of interleaved runs, medians beside),
render_scaling.json (many views, sizes, threads) and render.png, and prints a table.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import matplotlib
import numpy as np
from deodr import differentiable_renderer_cython as deodr
from deodr.differentiable_renderer import Scene2DBase
from deodr.triangulated_mesh import TriMeshAdjacencies

from meshslam.categories import load_category
from meshslam.categories.spheres import subdivide
from meshslam.geometry import Camera, MaskLoss, NoiseModel, ObjectModel, Pose, View, mask_gradients, mask_iou, render
from meshslam.objects import ObjectConfig
from meshslam.objects.observations import signed_distance, trace_border

matplotlib.use("Agg")
from matplotlib import pyplot

OUT = Path(__file__).resolve().parent / "out"
CAMERA = Camera(1242, 375, 721.5, 721.5, 609.6, 172.9)
AHEAD = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])  # camera from an object that faces away
DISTANCES_M = (8.0, 15.0, 30.0)
VIEW_COUNTS = (1, 2, 4, 8, 16, 32, 64)
TARGETS = {8.0: 8.0, 15.0: 12.0, 30.0: 12.0}
MODES = 16


@dataclass(frozen=True, eq=False)
class Mesh:
    """Vertices and faces."""

    vertices: np.ndarray
    faces: np.ndarray


def pose_at(distance_m: float, yaw_rad: float = 0.7, aside_m: float = 0.0) -> Pose:
    """Camera from object for a car on the road ahead."""
    return Pose(AHEAD @ Pose.from_yaw(yaw_rad, np.zeros(3)).rotation, np.array([aside_m, 0.9, distance_m]))


def observed_at(mesh: Mesh, distance_m: float, yaw_rad: float = 0.75, aside_m: float = 0.15) -> np.ndarray:
    """What a camera saw: the car a little larger, turned and moved."""
    return render(CAMERA, [(pose_at(distance_m, yaw_rad, aside_m), mesh.vertices * 1.03, mesh.faces)]).mask


def box_around(*masks: np.ndarray, margin: int = 3) -> tuple[int, int, int, int]:
    """Rectangle (x0, y0, x1, y1) around what any mask covers."""
    rows, columns = np.nonzero(np.any(masks, axis=0))
    x0, y0 = max(0, columns.min() - margin), max(0, rows.min() - margin)
    return x0, y0, min(CAMERA.width, columns.max() + margin + 1), min(CAMERA.height, rows.max() + margin + 1)


class Deodr:
    """DEODR's two core calls on a crop: one colour channel, no texture, sigma 1, its own silhouette edges."""

    def __init__(self, mesh: Mesh, pose: Pose, observed: np.ndarray, box: tuple[int, int, int, int]) -> None:
        x0, y0, x1, y1 = box
        points = pose.transform(mesh.vertices)
        ij = CAMERA.project(points) - [x0, y0]
        count, faces = len(points), mesh.faces.astype(np.uint32)
        edges = TriMeshAdjacencies(mesh.faces).edge_on_silhouette(ij)
        off = np.zeros(len(faces), bool)
        self.scene = Scene2DBase(
            faces=faces,
            faces_uv=faces,
            ij=ij,
            depths=points[:, 2].copy(),
            textured=off,
            uv=np.zeros((count, 2)),
            shade=np.zeros(count),
            colors=np.ones((count, 1)),
            shaded=off,
            edgeflags=edges,
            height=y1 - y0,
            width=x1 - x0,
            nb_colors=1,
            texture=np.zeros((0, 0)),
            background_color=np.zeros(1),
            uv_b=np.zeros((count, 2)),
            ij_b=np.zeros((count, 2)),
            shade_b=np.zeros(count),
            colors_b=np.zeros((count, 1)),
            texture_b=np.zeros((0, 0)),
        )
        self.image, self.depth = np.empty((y1 - y0, x1 - x0, 1)), np.empty((y1 - y0, x1 - x0))
        self.forward()
        seen = observed[y0:y1, x0:x1, None].astype(float)
        both = (seen * self.image).sum()
        union = (seen + self.image).sum() - both
        self.slope = np.where(seen > 0, -1 / union, both / union**2)

    def forward(self) -> None:
        """Draw."""
        deodr.renderSceneCpp(self.scene, 1.0, self.image, self.depth, False, None, None)

    def seconds(self) -> float:
        """Time of drawing and of going back; what is between and after them is left out."""
        start = time.perf_counter()
        self.forward()
        between = time.perf_counter()
        image = self.image.copy()  # going back overwrites it
        again = time.perf_counter()
        deodr.renderSceneBCpp(self.scene, 1.0, image, self.depth, self.slope, False, None, None, None)
        return between - start + time.perf_counter() - again


def opencv_seconds(mesh: Mesh, pose: Pose, box: tuple[int, int, int, int]) -> float:
    """Time of filling the front faces with OpenCV: forward only, the lower bound of what fills triangles."""
    corners = (CAMERA.project(pose.transform(mesh.vertices)) - box[:2])[mesh.faces]
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    front = np.round(corners[u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] < 0]).astype(np.int32)
    mask = np.zeros((box[3] - box[1], box[2] - box[0]), np.uint8)
    start = time.perf_counter()
    for triangle in front:
        cv2.fillConvexPoly(mask, triangle, 1)
    return time.perf_counter() - start


def solver_view(model: ObjectModel, observed: np.ndarray) -> View:
    """The observed mask as the solver takes it."""
    x0, y0, x1, y1 = box_around(observed, margin=12)
    crop = observed[y0:y1, x0:x1]
    distance_px = signed_distance(crop)
    nothing, none = np.zeros(crop.shape, np.uint8), np.zeros(0)
    border = trace_border(crop, distance_px, nothing, ObjectConfig().border_step_px)
    return model.view(
        CAMERA,
        Pose.identity(),
        origin=(x0, y0),
        distance_px=distance_px,
        cut=border.cut > 0,
        hidden=nothing > 0,
        border=border.pixels + [x0, y0],
        border_length_px=border.lengths_px,
        border_own=border.own,
        keypoint_index=none,
        keypoint_pixels=none,
        keypoint_sigma_px=none,
    )


def interleaved(timers: dict[str, Callable[[], list[float]]], rounds: int) -> dict[str, np.ndarray]:
    """Milliseconds of several things, taken in turn so that the machine's moods meet all of them."""
    found: dict[str, list[float]] = {name: [] for name in timers}
    for _ in range(rounds):
        for name, timer in timers.items():
            found[name] += timer()
    return {name: np.array(values) * 1e3 for name, values in found.items()}


def side_by_side(mesh: Mesh, model: ObjectModel, distance_m: float, rounds: int) -> dict[str, float]:
    """One distance: ours with loss and chain rule, DEODR's two calls, OpenCV's filling, the solver's linearization."""
    pose, observed = pose_at(distance_m), observed_at(mesh, distance_m)
    drawn = render(CAMERA, [(pose, mesh.vertices, mesh.faces)]).mask
    box = box_around(drawn, observed)
    loss = MaskLoss(
        CAMERA, len(mesh.vertices), mesh.faces, observed[box[1] : box[3], box[0] : box[2]], (int(box[0]), int(box[1]))
    )
    theirs = Deodr(mesh, pose, observed, box)
    view, state = solver_view(model, observed), model.state_at(pose)
    times = interleaved(
        {
            "meshslam": lambda: loss.seconds(pose, mesh.vertices, 20),
            "deodr": lambda: [theirs.seconds() for _ in range(5)],
            "opencv_forward": lambda: [opencv_seconds(mesh, pose, box) for _ in range(2)],
            "residuals": lambda: model.seconds([view], None, NoiseModel(), state, modes=True, free_form=False, runs=10),
        },
        rounds,
    )
    picture = np.zeros_like(drawn)
    picture[box[1] : box[3], box[0] : box[2]] = theirs.image[:, :, 0] >= 0.5
    row: dict[str, float] = {"distance_m": distance_m, "vertices": len(mesh.vertices), "threads": 1}
    row |= {f"{name}_ms": float(values.min()) for name, values in times.items()}
    row |= {f"{name}_median_ms": float(np.median(values)) for name, values in times.items()}
    return row | {
        "ratio": row["deodr_ms"] / row["meshslam_ms"],
        "ratio_of_medians": row["deodr_median_ms"] / row["meshslam_median_ms"],
        "residuals_over_gradient": row["residuals_ms"] / row["meshslam_ms"],
        "mask_iou": mask_iou(drawn, picture),
    }


def cropped_loss(mesh: Mesh, observed: np.ndarray) -> MaskLoss:
    """The loss against a mask that is cropped to its box, as detections are."""
    x0, y0, x1, y1 = box_around(observed)
    return MaskLoss(CAMERA, len(mesh.vertices), mesh.faces, observed[y0:y1, x0:x1], (int(x0), int(y0)))


def many_views(mesh: Mesh, count: int, threads: tuple[int, ...], rounds: int) -> list[dict[str, float]]:
    """Views around a car, 8 to 30 m away: time of all gradients, on each number of threads."""
    distances = np.linspace(8.0, 30.0, count)
    yaws = np.linspace(0.0, 2 * np.pi, count, endpoint=False) + 0.3
    losses = [cropped_loss(mesh, observed_at(mesh, d, y + 0.05)) for d, y in zip(distances, yaws, strict=True)]
    poses = [pose_at(d, y) for d, y in zip(distances, yaws, strict=True)]

    def timer(workers: int) -> Callable[[], list[float]]:
        return lambda: mask_gradients_seconds(losses, poses, mesh.vertices, workers)

    times = interleaved({str(n): timer(n) for n in threads}, rounds)
    return [
        {
            "vertices": len(mesh.vertices),
            "views": count,
            "threads": n,
            "meshslam_ms": float(times[str(n)].min()),
            "meshslam_median_ms": float(np.median(times[str(n)])),
        }
        for n in threads
    ]


def mask_gradients_seconds(
    losses: list[MaskLoss], poses: list[Pose], vertices: np.ndarray, threads: int
) -> list[float]:
    """Time of one call."""
    start = time.perf_counter()
    mask_gradients(losses, poses, vertices, threads)
    return [time.perf_counter() - start]


def plot(rows: list[dict[str, float]], scaling: list[dict[str, float]], path: Path) -> None:
    """Left: one view beside DEODR; right: cost against size and number of views."""
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
    distances = [row["distance_m"] for row in rows]
    names = {"deodr": "DEODR, two calls", "opencv_forward": "OpenCV, forward", "residuals": "residuals + Jacobian"}
    for name, label in ({"meshslam": "meshslam, loss + gradient"} | names).items():
        left.plot(distances, [row[f"{name}_ms"] for row in rows], "o-", label=label)
    left.set(xlabel="distance, m", ylabel="ms", yscale="log", title="one view, 642 vertices, one thread")
    left.legend()
    for vertices in sorted({row["vertices"] for row in scaling}):
        of = [row for row in scaling if row["vertices"] == vertices and row["threads"] == 1]
        right.plot([r["views"] for r in of], [r["meshslam_ms"] for r in of], "o-", label=f"{vertices} vertices")
    right.set(xlabel="views", ylabel="ms", xscale="log", yscale="log", title="loss + gradient of all views, one thread")
    right.legend()
    for axis in (left, right):
        axis.grid(alpha=0.3, which="both")
    figure.savefig(path, dpi=130)


def table(rows: list[dict[str, float]]) -> str:
    """The side-by-side rows as Markdown."""
    head = "| distance | meshslam ms | DEODR ms | ratio | target | mask IoU | OpenCV ms | residuals ms | of gradient |"
    lines = [head, "| --- " * 9 + "|"]
    for r in rows:
        lines.append(
            f"| {r['distance_m']:.0f} m | {r['meshslam_ms']:.4f} ({r['meshslam_median_ms']:.4f}) "
            f"| {r['deodr_ms']:.3f} ({r['deodr_median_ms']:.3f}) | {r['ratio']:.1f} ({r['ratio_of_medians']:.1f}) "
            f"| {TARGETS[r['distance_m']]:.0f} | {r['mask_iou']:.3f} | {r['opencv_forward_ms']:.3f} "
            f"| {r['residuals_ms']:.4f} | {r['residuals_over_gradient']:.1f}x |"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one view beside DEODR only")
    parser.add_argument("--rounds", type=int, default=40, help="turns that each timer gets")
    a = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    car = load_category("car")
    mesh = Mesh(car.vertices, car.faces)
    model = ObjectModel(
        car.vertices, car.faces, car.modes[:MODES], car.mirror, car.keypoint_weights, car.wheel_vertices
    )
    rows = [side_by_side(mesh, model, distance_m, a.rounds) for distance_m in DISTANCES_M]
    print("minima, medians in brackets\n" + table(rows))
    (OUT / "render.json").write_text(json.dumps(rows, indent=1) + "\n")
    if a.quick:
        return

    one, two = many_views(mesh, 64, (1, 2), a.rounds)
    print(f"64 views: 1 thread {one['meshslam_ms']:.2f} ms, 2 threads {two['meshslam_ms']:.2f} ms: ", end="")
    print(f"{one['meshslam_ms'] / two['meshslam_ms']:.2f} times, {speedup(one, two):.2f} by medians")
    scaling = [one, two]
    sizes = [mesh]
    for _ in range(2):
        sizes.append(Mesh(*subdivide(sizes[-1].vertices, sizes[-1].faces)))
    for size in sizes:
        for count in VIEW_COUNTS:
            scaling += many_views(size, count, (1,), 8)
    (OUT / "render_scaling.json").write_text(json.dumps(scaling, indent=1) + "\n")
    plot(rows, scaling[2:], OUT / "render.png")
    print(f"wrote render.json, render_scaling.json and render.png in {OUT}")


def speedup(one: dict[str, float], two: dict[str, float]) -> float:
    return one["meshslam_median_ms"] / two["meshslam_median_ms"]


if __name__ == "__main__":
    main()
