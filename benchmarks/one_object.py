"""How long one object takes on one core: 8 views at 7 m of every car model, from key points and masks to free form.

    .venv/bin/python benchmarks/one_object.py [--cars 24]

Needs the shared data ($MESHSLAM_DATA, or ../shared/data), as benchmarks/shape.py does.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from shape import ring

from meshslam.categories import load_category
from meshslam.mapping.pipeline import make_scene, with_noise_of
from meshslam.mapping.selection import usable_tracks
from meshslam.mapping.work import Work, fit_again, observe
from meshslam.objects import Occluders, fit_free_form, reconstruct, uncertainty
from meshslam.runs import Config, Outlet, map_recording
from meshslam.sequences import open_sequence

Made = TypeVar("Made")
STEPS = ("views", "start, pose, modes", "with the noise known", "free form", "pose covariance", "with each vertex's")


def timed(spent: dict[str, float], step: str, work: Callable[[], Made]) -> Made:
    """What the work gives; the time of this thread is added to the step."""
    start = time.thread_time()
    made = work()
    spent[step] = spent.get(step, 0.0) + time.thread_time() - start
    return made


def one_object(seed: int) -> dict[str, float]:
    """Seconds of each step for the car of a ring."""
    case = ring(8, seed)
    made = map_recording(open_sequence(case), Config(), Outlet())
    frames, found, objects = made.frames, made.mapping.detections, Config().objects
    scene = make_scene(frames, found, load_category("car"), objects)
    (track,), _ = usable_tracks(frames, found, "car", Config().mapping, objects.min_view_box_px)
    occluders = Occluders(frames.camera, found.by_frame(), frames.pose_of_frame())

    spent: dict[str, float] = {}
    observed = timed(spent, "views", lambda: observe(track, scene, occluders))
    first = timed(spent, "start, pose, modes", lambda: reconstruct(observed, scene))
    work = Work(observed, first)

    def again() -> Work:
        return fit_again(work, with_noise_of(scene, [work]))

    work = timed(spent, "with the noise known", again)
    shaped = timed(spent, "free form", lambda: fit_free_form(work.observed, scene, work.found))
    timed(spent, "pose covariance", lambda: uncertainty(work.observed, scene, shaped, per_vertex=False))
    timed(spent, "with each vertex's", lambda: uncertainty(work.observed, scene, shaped))
    return spent


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cars", type=int, default=24)
    parser.add_argument("--rounds", type=int, default=5)
    a = parser.parse_args()
    rounds = [[one_object(seed) for seed in range(a.cars)] for _ in range(a.rounds)]
    of_car = np.array([[[spent[step] for step in STEPS] for spent in row] for row in rounds]).min(axis=0) * 1e3
    totals = {
        "key points to free form": of_car[:, 1:4].sum(axis=1),
        "with views": of_car[:, :4].sum(axis=1),
        "and pose covariance": of_car[:, :5].sum(axis=1),
        "and each vertex's": of_car[:, [0, 1, 2, 3, 5]].sum(axis=1),
    }
    print(f"{a.cars} cars, least of {a.rounds} rounds, ms: median over the cars (90%)")
    for name, values in {**dict(zip(STEPS, of_car.T, strict=True)), **totals}.items():
        print(f"{name:28s} {np.median(values):7.1f} ({np.percentile(values, 90):.1f})")


if __name__ == "__main__":
    main()
