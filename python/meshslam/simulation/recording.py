"""A street as a sequence folder with its truth beside it (docs/formats.md)."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from meshslam.errors import SequenceError
from meshslam.files import write_into
from meshslam.geometry import Bools, Bytes, Floats, Rendering
from meshslam.maps import MovingPath, PlyMesh, format_ply
from meshslam.objects import signed_distance
from meshslam.perception import CategoryEntry, Detection, DetectionSet, ImageEntry, encode_mask, write_detections
from meshslam.sequences import InitialState, format_tum, write_sequence_folder
from meshslam.settings import Settings, setting
from meshslam.simulation.lens import render_through
from meshslam.simulation.motion import IMU_FROM_CAMERA, ImuNoise, ImuReadings, simulated_imu
from meshslam.simulation.render import draw, render_image, visible
from meshslam.simulation.street import Car, Street

_INSTANT_S = 0.05  # half the time over which a turn rate is taken


@dataclass(frozen=True)
class ObserverConfig(Settings):
    """How a network would see the street."""

    border_sigma_px: float = setting(0.7, low=0)  # of the masks' borders, smooth along them
    keypoint_sigma_share: float = setting(0.01, low=0)  # of the box's larger side
    min_keypoint_sigma_px: float = setting(1.0, low=0)
    wild_share: float = setting(0.03, low=0, high=1)  # of the key points lie anywhere in the box
    keypoints: bool = setting(True)
    min_area_px: int = setting(250, low=0, unit="px²")  # of a mask that is seen
    min_visible_share: float = setting(0.3, low=0, high=1)


EXACT = ObserverConfig(border_sigma_px=0.0, keypoint_sigma_share=0.0, min_keypoint_sigma_px=0.0, wild_share=0.0)


def write_recording(
    street: Street,
    folder: Path | str,
    observer: ObserverConfig | None = None,
    progress: Callable[[str, int, int], None] | None = None,
    imu_noise: ImuNoise | None = None,
    *,
    known_poses: bool = True,
) -> Path:
    """Write images, detections without track ids, poses, IMU, and truth: the same street gives the same bytes.

    Moving cars are in `moving.json`, with their paths, not in `objects.json`. `known_poses` are those that
    may be used (poses.tum); the true path is there in any case. SequenceError if the folder cannot be written.
    """
    folder = Path(folder)
    detections, object_of_annotation = observe(street, observer or ObserverConfig())
    imu = street.imu or _simulated(street, imu_noise or ImuNoise())
    write_sequence_folder(
        folder,
        street.camera,
        street.times_s,
        images=_images(street, progress),
        detections=json.loads(write_detections(detections)),
        world_from_camera=street.world_from_camera if known_poses else None,
        imu=None if imu is None else imu.samples,
        imu_from_camera=None if imu is None else imu.imu_from_camera,
        initial_state=None if imu is None else _initial_state(street, imu),
        height_above_ground_m=street.camera_height_m,
        distortion=street.distortion,
    )
    write_truth(street, object_of_annotation, folder)
    return folder


def _images(street: Street, progress: Callable[[str, int, int], None] | None) -> Iterator[Bytes]:
    """Frames in their order, drawn side by side, a few ahead of the one that is taken."""
    count, threads = len(street.times_s), os.cpu_count() or 1
    with ThreadPoolExecutor(threads) as pool:
        for first in range(0, count, 2 * threads):
            part = range(first, min(first + 2 * threads, count))
            for index, image in zip(part, pool.map(partial(render_image, street), part), strict=True):
                if progress is not None:
                    progress("render", index + 1, count)
                yield image


def _simulated(street: Street, noise: ImuNoise) -> ImuReadings | None:
    """An IMU along the path; None for one frame alone, which has no motion."""
    if len(street.times_s) < 2:
        return None
    rng = np.random.default_rng([street.seed, 3, street.drive])
    return simulated_imu(street.times_s, street.world_from_camera, IMU_FROM_CAMERA, noise, rng)


def _initial_state(street: Street, imu: ImuReadings) -> InitialState:
    return InitialState(float(street.times_s[0]), street.world_from_camera[0], imu.velocity_in_world)


def observe(street: Street, config: ObserverConfig) -> tuple[DetectionSet, dict[int, int]]:
    """Detections of every car in every frame, without track ids, and which car each annotation shows."""
    rng = np.random.default_rng([street.seed, 1, street.drive] if street.drive else [street.seed, 1])
    found: list[Detection] = []
    truth: dict[int, int] = {}
    for index in range(len(street.times_s)):
        drawn = draw(street, index)
        for number, car in enumerate(street.cars):
            detection = _detection(len(found) + 1, street, index, drawn, number, rng, config)
            if detection is not None:
                truth[detection.id] = car.id
                found.append(detection)
    size = (street.camera.width, street.camera.height)
    images = tuple(ImageEntry(i, f"{i:06d}.png", *size) for i in range(len(street.times_s)))
    first = street.cars[0]
    names = tuple(first.keypoints) if config.keypoints else ()
    return DetectionSet(images, (CategoryEntry(1, first.category, names),), tuple(found)), truth


def _detection(
    annotation: int,
    street: Street,
    index: int,
    drawn: Rendering,
    number: int,
    rng: np.random.Generator,
    config: ObserverConfig,
) -> Detection | None:
    """One car in one frame; None if too little of it is seen."""
    car = street.cars[number]
    exact = (drawn.object_index == number).astype(np.uint8)
    if exact.sum() < config.min_area_px or exact.sum() < config.min_visible_share * _whole_area(street, index, number):
        return None
    mask = roughen(exact, rng, config.border_sigma_px) if config.border_sigma_px > 0 else exact
    x, y, width, height = cv2.boundingRect(mask)
    camera_from_object = street.world_from_camera[index].inverse() @ car.at(float(street.times_s[index]))
    points = camera_from_object.transform(np.array(list(car.keypoints.values())))
    pixels, depths_m = street.project(points)
    shown = visible(drawn, number, pixels, depths_m)
    box = (float(x), float(y), float(width), float(height))
    seen, scores = _seen_keypoints(pixels, shown, box, rng, config)
    score = float(np.round(np.clip(rng.normal(0.85, 0.06), 0.4, 0.99), 3))
    found = Detection(annotation, index, car.category, score, box, encode_mask(mask), mask.shape, seen, scores)
    return found if config.keypoints else replace(found, keypoints=None, keypoint_scores=None)


def _whole_area(street: Street, index: int, number: int) -> float:
    """Pixels that the car would cover with nothing before it."""
    car = street.cars[number]
    camera_from_object = street.world_from_camera[index].inverse() @ car.at(float(street.times_s[index]))
    alone = render_through(street.distortion, street.camera, [(camera_from_object, car.vertices, car.faces)])
    return float(alone.mask.sum())


def roughen(mask: Bytes, rng: np.random.Generator, sigma_px: float) -> Bytes:
    """Move a mask's border by a smooth random field of `sigma_px`, as a network's masks are."""
    field = np.asarray(cv2.GaussianBlur(rng.standard_normal(mask.shape), (0, 0), 7))
    shift_px = field / max(float(field.std()), 1e-9) * sigma_px
    moved: Bytes = (signed_distance(mask) + shift_px < 0).astype(np.uint8)
    return moved if moved.any() else mask


def _seen_keypoints(
    pixels: Floats,
    shown: Bools,
    box: tuple[float, float, float, float],
    rng: np.random.Generator,
    config: ObserverConfig,
) -> tuple[Floats, Floats]:
    """Noisy key points (K, 2) and scores (K,); what is not shown has score 0 and lies at 0, 0."""
    sigma = max(config.min_keypoint_sigma_px, config.keypoint_sigma_share * max(box[2:]))
    noisy = pixels + rng.normal(0.0, sigma, pixels.shape)
    wild = rng.random(len(pixels)) < config.wild_share
    anywhere = np.array(box[:2]) + rng.random(pixels.shape) * np.array(box[2:])
    noisy = np.where(wild[:, None], anywhere, noisy)
    scores: Floats = np.where(shown, np.clip(rng.normal(0.75, 0.1, len(pixels)), 0.35, 0.99), 0.0)
    points: Floats = np.where(shown[:, None], noisy, 0.0)
    return points.round(2), scores.round(3)


def write_truth(street: Street, object_of_annotation: dict[int, int], folder: Path) -> None:
    """Write the cars, parked and driving, which annotation shows which, and the camera's path, for scoring only."""
    parked = [car for car in street.cars if not car.moves]
    moving = [car for car in street.cars if car.moves]
    try:
        for name in ("meshes", *(["moving"] if moving else [])):
            (folder / name).mkdir(exist_ok=True)
        for car in street.cars:
            write_into(folder / _mesh_name(car), format_ply(PlyMesh(car.vertices, car.faces)), SequenceError)
        document = {"objects": [_truth_entry(car) for car in parked]}
        write_into(folder / "objects.json", json.dumps(document, indent=1) + "\n", SequenceError)
        for car in moving:
            write_into(folder / _path_name(car), true_path(car, street.times_s).to_csv(), SequenceError)
        if moving:
            driving = {"objects": [], "moving": [_moving_entry(car, street.times_s) for car in moving]}
            write_into(folder / "moving.json", json.dumps(driving, indent=1) + "\n", SequenceError)
        write_into(folder / "association.json", json.dumps(object_of_annotation) + "\n", SequenceError)
        path = format_tum(street.times_s, street.world_from_camera)
        write_into(folder / "groundtruth.tum", path, SequenceError)
    except OSError as error:
        raise SequenceError(f"{error.filename or folder}: cannot be written: {error.strerror}") from None


def _mesh_name(car: Car) -> str:
    return f"meshes/{car.id:03d}.ply"


def _path_name(car: Car) -> str:
    return f"moving/{car.id:03d}.csv"


def true_path(car: Car, times_s: Floats) -> MovingPath:
    """Where a car is at each time, and how it drives; nothing of it is uncertain."""
    poses, count = tuple(car.at(float(t)) for t in times_s), len(times_s)
    velocity = np.array([car.velocity(float(t)) for t in times_s])
    ahead = np.array([pose.rotation[:, 0] for pose in poses])
    turns = [car.at(float(t - _INSTANT_S)).rotation.T @ car.at(float(t + _INSTANT_S)).rotation for t in times_s]
    rates = np.array([np.arctan2(turn[1, 0], turn[0, 0]) for turn in turns]) / (2 * _INSTANT_S)
    nothing = np.zeros(count)
    return MovingPath(
        times_s,
        tuple(range(count)),
        poses,
        np.zeros((count, 6, 6)),
        velocity,
        (velocity * ahead).sum(1),
        nothing,
        rates,
        nothing,
    )


def _moving_entry(car: Car, times_s: Floats) -> dict[str, object]:
    """A car that drives, as it is at the first time."""
    return {**_truth_entry(car), "moving": True, "timestamp": float(times_s[0]), "path": _path_name(car)}


def _truth_entry(car: Car) -> dict[str, object]:
    return {
        "id": car.id,
        "category": car.category,
        "world_from_object": np.round(car.start.matrix, 9).tolist(),
        "dimensions": np.round(np.ptp(car.vertices, axis=0), 6).tolist(),
        "mesh": _mesh_name(car),
        "keypoints": {name: np.round(point, 6).tolist() for name, point in car.keypoints.items()},
    }
