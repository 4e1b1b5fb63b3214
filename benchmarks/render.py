"""The renderer and its gradients beside DEODR and OpenCV and beside another of its builds; threads, sizes and views.

    .venv/bin/python benchmarks/render.py [--quick] [--against FOLDER_OF_ANOTHER_CHECKOUT]

Writes benchmarks/out/render.json (one view and a large mesh beside DEODR: minima of interleaved runs, medians beside),
render_scaling.json (many views, sizes, threads), render.png, and prints tables. `--against` compares with another
checkout whose build lies in its python/meshslam, and writes render_against.json only.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path

import matplotlib
import numpy as np
from render_against import against
from render_cases import CAMERA, DISTANCES_M, Mesh, box_around, cropped_loss, interleaved, observed_at, pose_at
from render_peers import Deodr, opencv_seconds

from meshslam.categories import load_category
from meshslam.categories.spheres import subdivide
from meshslam.geometry import MaskLoss, NoiseModel, ObjectModel, Pose, View, mask_gradients, mask_iou, render
from meshslam.objects import ObjectConfig
from meshslam.objects.observations import signed_distance, trace_border

matplotlib.use("Agg")
from matplotlib import pyplot

OUT = Path(__file__).resolve().parent / "out"
VIEW_COUNTS = (1, 2, 4, 8, 16, 32, 64)
TARGETS = {8.0: 48.0, 15.0: 36.0, 30.0: 32.0}
MODES = 16


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


def side_by_side(mesh: Mesh, model: ObjectModel, distance_m: float, rounds: int) -> dict[str, float]:
    """One distance: ours with loss and chain rule, DEODR's two calls, OpenCV's filling, the solver's linearization."""
    pose, observed = pose_at(distance_m), observed_at(mesh, distance_m)
    drawn = render(CAMERA, [(pose, mesh.vertices, mesh.faces)]).mask
    box = box_around(drawn, observed)
    loss = cropped_loss(mesh, observed, box)
    theirs = Deodr(mesh, pose, observed, box)
    view, state = solver_view(model, observed), model.state_at(pose)
    times = interleaved(
        {
            "meshslam": lambda: loss.seconds(pose, mesh.vertices, 20),
            "from_python": lambda: [called_seconds(loss, pose, mesh) for _ in range(20)],
            "new_vertices": lambda: [called_seconds(loss, pose, nudged(mesh, k)) for k in range(10)],
            "deodr": lambda: [theirs.seconds() for _ in range(5)],
            "opencv_forward": lambda: [opencv_seconds(mesh, pose, box) for _ in range(2)],
            "residuals": lambda: model.seconds([view], None, NoiseModel(), state, modes=True, free_form=False, runs=10),
        },
        rounds,
    )
    row = row_of(distance_m, mesh, times) | {"mask_iou": iou_within(drawn, theirs.image[:, :, 0], box)}
    return row | {
        "from_python_over_rust": row["from_python_ms"] / row["meshslam_ms"],
        "residuals_over_gradient": row["residuals_ms"] / row["meshslam_ms"],
    }


def row_of(distance_m: float, mesh: Mesh, times: dict[str, np.ndarray]) -> dict[str, float]:
    """Minima and medians, and how many times as long DEODR takes."""
    row: dict[str, float] = {"distance_m": distance_m, "vertices": len(mesh.vertices), "threads": 1}
    row |= {f"{name}_ms": float(values.min()) for name, values in times.items()}
    row |= {f"{name}_median_ms": float(np.median(values)) for name, values in times.items()}
    return row | {
        "ratio": row["deodr_ms"] / row["meshslam_ms"],
        "ratio_of_medians": row["deodr_median_ms"] / row["meshslam_median_ms"],
    }


def iou_within(drawn: np.ndarray, image: np.ndarray, box: tuple[int, int, int, int]) -> float:
    """Overlap of a mask with another's coverage on a crop."""
    picture = np.zeros_like(drawn)
    picture[box[1] : box[3], box[0] : box[2]] = image >= 0.5
    return mask_iou(drawn, picture)


def called_seconds(loss: MaskLoss, pose: Pose, mesh: Mesh) -> float:
    """Time of a call from Python whose results are read."""
    start = time.perf_counter()
    found = loss.gradient(pose, mesh.vertices)
    assert found.vertices.shape == mesh.vertices.shape
    return time.perf_counter() - start


def nudged(mesh: Mesh, k: int) -> Mesh:
    """The mesh with other vertices, for calls that know nothing of the one before."""
    return Mesh(mesh.vertices * (1 + 1e-9 * (k + 1)), mesh.faces)


def large_of(mesh: Mesh) -> Mesh:
    """The mesh with each face parted, to about 100,000 faces."""
    while len(mesh.faces) < 80_000:
        mesh = Mesh(*subdivide(mesh.vertices, mesh.faces))
    return mesh


def large_mesh(mesh: Mesh, distance_m: float, rounds: int) -> dict[str, float]:
    """A mesh of about 100,000 faces beside DEODR."""
    mesh = large_of(mesh)
    pose, observed = pose_at(distance_m), observed_at(mesh, distance_m)
    drawn = render(CAMERA, [(pose, mesh.vertices, mesh.faces)]).mask
    box = box_around(drawn, observed)
    loss, theirs = cropped_loss(mesh, observed, box), Deodr(mesh, pose, observed, box)
    times = interleaved(
        {
            "meshslam": lambda: loss.seconds(pose, mesh.vertices, 8),
            "new_vertices": lambda: [called_seconds(loss, pose, nudged(mesh, k)) for k in range(2)],
            "deodr": lambda: [theirs.seconds()],
        },
        rounds,
    )
    found = row_of(distance_m, mesh, times) | {"faces": len(mesh.faces)}
    return found | {"mask_iou": iou_within(drawn, theirs.image[:, :, 0], box)}


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
    head = (
        "| distance | meshslam ms | DEODR ms | ratio | target | mask IoU | from Python | new vertices ms | OpenCV ms "
        "| residuals ms | of gradient |"
    )
    lines = [head, "| --- " * 11 + "|"]
    for r in rows:
        lines.append(
            f"| {r['distance_m']:.0f} m | {r['meshslam_ms']:.4f} ({r['meshslam_median_ms']:.4f}) "
            f"| {r['deodr_ms']:.3f} ({r['deodr_median_ms']:.3f}) | {r['ratio']:.1f} ({r['ratio_of_medians']:.1f}) "
            f"| {TARGETS[r['distance_m']]:.0f} | {r['mask_iou']:.3f} | {r['from_python_over_rust']:.2f}x "
            f"| {r['new_vertices_ms']:.4f} | {r['opencv_forward_ms']:.3f} "
            f"| {r['residuals_ms']:.4f} | {r['residuals_over_gradient']:.1f}x |"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one view beside DEODR only")
    parser.add_argument("--rounds", type=int, default=40, help="turns that each timer gets")
    parser.add_argument("--against", type=Path, help="another checkout with its build in python/meshslam")
    a = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    car = load_category("car")
    mesh = Mesh(car.vertices, car.faces)
    if a.against:
        compared = against(Path(__file__).resolve().parent.parent, a.against, mesh, large_of(mesh), a.rounds)
        (OUT / "render_against.json").write_text(json.dumps(compared, indent=1) + "\n")
        return
    model = ObjectModel(
        car.vertices, car.faces, car.modes[:MODES], car.mirror, car.keypoint_weights, car.wheel_vertices
    )
    rows = [side_by_side(mesh, model, distance_m, a.rounds) for distance_m in DISTANCES_M]
    print("minima, medians in brackets\n" + table(rows))
    large = large_mesh(mesh, 15.0, max(a.rounds // 4, 2))
    print(
        f"{large['faces']} faces at 15 m: {large['meshslam_ms']:.3f} ms ({large['meshslam_median_ms']:.3f}), "
        f"new vertices {large['new_vertices_ms']:.3f} ms, DEODR {large['deodr_ms']:.2f} ms "
        f"({large['deodr_median_ms']:.2f}): {large['ratio']:.1f} times ({large['ratio_of_medians']:.1f})"
    )
    found = {"one_view": rows, "large_mesh": large}
    (OUT / "render.json").write_text(json.dumps(found, indent=1) + "\n")
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
