"""How long perception takes: segmentation and key points by threads and batch, tracking, per frame of a real drive.

    .venv/bin/python benchmarks/perception.py [--frames 22] [--network FILE] [--sequence FOLDER]

Wall time and processor time, ms; needs the shared data ($MESHSLAM_DATA, or ../shared/data) unless both are given.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import cv2
import numpy as np

from meshslam.perception import KeypointConfig, KeypointFinder, add_keypoints, detect, load_segmenter, track
from meshslam.sequences import open_sequence

ROOT = Path(__file__).resolve().parent
DATA = Path(os.environ.get("MESHSLAM_DATA", ROOT.parent.parent / "shared" / "data"))
DRIVE = DATA / "kitti_raw" / "2011_09_26" / "2011_09_26_drive_0048_sync"
NETWORK = DATA / "models" / "yolov5n-seg.onnx"
ROUNDS = 5  # the fastest counts


def fastest(count: int, work: Callable[..., object], *arguments: object) -> str:
    """Wall and processor time of one of `count` things that `work` does to its arguments, ms."""
    best = (np.inf, np.inf)
    for _ in range(ROUNDS):
        wall, processor = time.perf_counter(), time.process_time()
        work(*arguments)
        best = min(best, (time.perf_counter() - wall, time.process_time() - processor))
    return f"{1e3 * best[0] / count:.2f} | {1e3 * best[1] / count:.2f} |"


def find_all(finder: KeypointFinder, images: list[np.ndarray], masks: list[list[np.ndarray]]) -> None:
    """Key points of the cars of every frame."""
    for image, of_frame in zip(images, masks, strict=True):
        finder.find(image, of_frame)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sequence", type=Path, default=DRIVE)
    parser.add_argument("--network", type=Path, default=NETWORK)
    parser.add_argument("--frames", type=int, default=22)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--batches", type=int, nargs="+", default=[1, 4, 8, 16])
    a = parser.parse_args()

    recording = open_sequence(a.sequence)
    images = [recording.read_image(i) for i in range(min(a.frames, len(recording)))]
    frames: Iterable[tuple[int, np.ndarray]] = list(enumerate(images))
    print(f"{len(images)} frames of {images[0].shape[1]} x {images[0].shape[0]}")
    print("| what | wall | processor |\n| --- | --- | --- |")
    for threads in a.threads:
        cv2.setNumThreads(threads)
        segmenter = load_segmenter(a.network, threads=threads)
        print(f"| segmentation, a frame, {threads} threads |", fastest(len(images), detect, frames, segmenter))
    found = detect(frames, segmenter)
    pointed = add_keypoints(found, images.__getitem__, KeypointFinder())
    masks = [[d.mask() for d in row if d.keypoints is not None] for row in pointed.by_frame().values()]
    cars = sum(len(of_frame) for of_frame in masks)
    for threads in a.threads:
        for batch in a.batches:
            finder = KeypointFinder(KeypointConfig(threads=threads, batch=batch))
            label = f"| key points, a car, {threads} threads, batches of {batch} |"
            print(label, fastest(cars, find_all, finder, images, masks))
    finder = KeypointFinder()
    print("| key points, a frame |", fastest(len(images), add_keypoints, found, images.__getitem__, finder))
    print("| tracking, a frame |", fastest(len(images), track, pointed, images.__getitem__))


if __name__ == "__main__":
    main()
