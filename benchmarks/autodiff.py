"""What the operators of PyTorch and JAX cost beside the core's own call, and whether memory stays flat.

    .venv-torch/bin/python benchmarks/autodiff.py [--rounds 30]           # time, in turns, minima
    .venv-torch/bin/python benchmarks/autodiff.py --memory [CALLS]        # resident memory over a million calls of each

One step is −IoU and its gradient over vertices and poses. Frameworks that are not installed are left out.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from meshslam.categories import icosphere, load_category
from meshslam.geometry import Camera, Pose, batched_mask_loss, intrinsics_of, render

AHEAD = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
Step = Callable[[], object]


def scene(views: int, size: int, vertices: np.ndarray, faces: np.ndarray):
    """Poses (n, 4, 4), intrinsics, masks (n, h, w) of a mesh seen from all around."""
    camera = Camera(size, size, 1.7 * size, 1.7 * size, size / 2 - 0.5, size / 2 - 0.5)
    poses = [Pose(AHEAD, np.array([0.1, 0.2, 9.0])) @ Pose.from_yaw(0.3 * k, np.zeros(3)) for k in range(views)]
    masks = [render(camera, [(pose, 1.03 * vertices, faces)]).mask for pose in poses]
    return np.stack([pose.matrix for pose in poses]), intrinsics_of(camera), np.stack(masks)


def steps(vertices, faces, poses, camera, masks, threads: int) -> dict[str, Step]:
    """The same step by each way there is."""
    found: dict[str, Step] = {
        "core": lambda: batched_mask_loss(vertices, faces, poses, camera, masks, threads=threads),
    }
    try:
        import torch

        from meshslam.autodiff import torch as of_torch

        v, p = (torch.tensor(x, requires_grad=True) for x in (vertices, poses))
        f, m = torch.tensor(faces), torch.tensor(masks)

        def torch_step() -> None:
            v.grad = p.grad = None
            of_torch.mask_iou_loss(v, f, p, camera, m, threads=threads).sum().backward()

        found["PyTorch"] = torch_step
    except ImportError:
        pass
    try:
        import jax

        jax.config.update("jax_enable_x64", True)
        from meshslam.autodiff import jax as of_jax

        def total(v, p):
            return of_jax.mask_iou_loss(v, faces, p, camera, masks, threads=threads).sum()

        gradient = jax.jit(jax.grad(total, argnums=(0, 1)))
        on_device = jax.numpy.asarray(vertices), jax.numpy.asarray(poses)
        found["JAX"] = lambda: jax.block_until_ready(gradient(*on_device))
    except ImportError:
        pass
    return found


def seconds(step: Step, runs: int) -> float:
    """Of the fastest of some runs."""
    best = np.inf
    for _ in range(runs):
        began = time.perf_counter()
        step()
        best = min(best, time.perf_counter() - began)
    return best


def times(rounds: int) -> None:
    """Each way in turn, round after round; the minima, and the medians of the rounds' ratios."""
    car = load_category("car")
    for views, size in ((1, 256), (20, 128), (20, 256), (20, 640)):
        given = scene(views, size, car.vertices, car.faces)
        for threads in (1, 0):
            ways = steps(car.vertices, car.faces, *given, threads)
            for step in ways.values():
                seconds(step, 3)
            table = np.array([[seconds(step, 8) for step in ways.values()] for _ in range(rounds)])
            best, ratio = table.min(0), np.median(table / table[:, :1], axis=0)
            shown = [
                f"{n} {1e3 * b:.3f} ms ({b / best[0]:.2f}, {r:.2f})" for n, b, r in zip(ways, best, ratio, strict=True)
            ]
            print(f"{views} views of {size} x {size}, {('all threads', 'one thread')[threads]}: {', '.join(shown)}")


def resident_mb() -> float:
    """Memory of this process that is in RAM."""
    line = next(x for x in Path("/proc/self/status").read_text().splitlines() if x.startswith("VmRSS"))
    return int(line.split()[1]) / 1024


def memory(calls: int) -> None:
    """Resident memory at tenths of the way, after a warm-up."""
    ball = icosphere(1)
    given = scene(2, 32, ball.vertices, ball.faces)
    for name, step in steps(ball.vertices, ball.faces, *given, 1).items():
        for _ in range(calls // 20):
            step()
        seen = [resident_mb()]
        for _ in range(10):
            for _ in range(calls // 10):
                step()
            seen.append(resident_mb())
        print(
            f"{name}, {calls} calls: {', '.join(f'{mb:.1f}' for mb in seen)} MB, grown by {seen[-1] - seen[0]:.2f}",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=30)
    parser.add_argument("--memory", type=int, nargs="?", const=1_000_000)
    options = parser.parse_args()
    if options.memory:
        memory(options.memory)
    else:
        times(options.rounds)


if __name__ == "__main__":
    main()
