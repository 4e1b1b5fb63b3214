"""Memory of a long stream: a Localizer on a simulated street, its resident memory every 1,000 frames.

    python benchmarks/stream_memory.py [FRAMES]

The camera swings forwards and backwards along a street, with the masks and key points that the street shows it and the
readings of an IMU that goes with it; there are no images, and the tracker numbers the detections.
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from meshslam.categories import load_category
from meshslam.geometry import Pose
from meshslam.localization import Localizer
from meshslam.maps import Map, MapObject
from meshslam.sequences import ImuSamples, InitialState
from meshslam.simulation import ObserverConfig, StreetConfig, make_street, observe

IMU_FROM_CAMERA = Pose(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.zeros(3))
RATE_HZ = 100
FRAMES = 160  # of one swing, 0.1 s each
LENGTH_M = 40.0
OMEGA = 2 * np.pi / (0.1 * FRAMES)


def rss_mb() -> float:
    """Resident memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def main(frames: int) -> None:
    """Print memory, time per frame and the largest error every 1,000 frames."""
    size = StreetConfig(frames=60, width_px=560, height_px=180, focal_px=330.0, moving_cars=0)
    street = make_street(load_category("car"), 4, size)
    first = street.world_from_camera[0]
    ahead = first.rotation[:, 2]
    along = 0.5 * LENGTH_M * (1 - np.cos(OMEGA * 0.1 * np.arange(FRAMES)))
    swing = tuple(Pose(first.rotation, first.translation + s * ahead) for s in along)
    found, _ = observe(replace(street, times_s=0.1 * np.arange(FRAMES), world_from_camera=swing), ObserverConfig())
    shown = list(found.by_frame().values())
    cars = [MapObject(c.id, c.category, c.start, c.vertices, c.faces, keypoints=c.keypoints) for c in street.cars]
    localizer = Localizer(
        street.camera,
        Map(tuple(cars)),
        imu_from_camera=IMU_FROM_CAMERA,
        start=InitialState(0.0, swing[0], np.zeros(3)),
        keypoint_names={"car": tuple(street.cars[0].keypoints)},
    )
    gravity = (first @ IMU_FROM_CAMERA.inverse()).rotation.T @ np.array([0.0, 0.0, 9.81])
    began, sent, worst_m, rng = time.perf_counter(), 0, 0.0, np.random.default_rng(1)
    for index in range(frames):
        ready = index * RATE_HZ // 10 + 1
        samples, sent = _samples(np.arange(sent, ready) / RATE_HZ, gravity, rng), ready
        detections = [replace(d, track_id=None) for d in shown[index % FRAMES]]
        state = localizer.process(time_s=0.1 * index, imu=samples, detections=detections)
        if state.world_from_camera is not None:
            off = state.world_from_camera.translation - swing[index % FRAMES].translation
            worst_m = max(worst_m, float(np.linalg.norm(off)))
        if (index + 1) % 1000 == 0:
            each_ms = (time.perf_counter() - began) / (index + 1) * 1000
            print(f"{index + 1} frames: {rss_mb():.0f} MB, {each_ms:.1f} ms a frame, {worst_m:.3f} m", flush=True)


def _samples(times_s: np.ndarray, gravity: np.ndarray, rng: np.random.Generator) -> ImuSamples:
    forwards = 0.5 * LENGTH_M * OMEGA**2 * np.cos(OMEGA * times_s)
    force = gravity + forwards[:, None] * [1.0, 0.0, 0.0] + rng.normal(0, 0.03, (len(times_s), 3))
    return ImuSamples(times_s, rng.normal(0, 1e-3, (len(times_s), 3)), force)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000)
