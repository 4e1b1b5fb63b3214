"""Where an object is, before its shape is known (paper, Sec. IV-C)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from meshslam.categories import Category, keypoint_order
from meshslam.geometry import Camera, Floats, GroundPlane, NoiseModel, ObjectModel, Pose, View, kabsch, triangulate
from meshslam.objects.config import ObjectConfig
from meshslam.objects.observations import keypoints_of
from meshslam.objects.track import Track, is_cut


def triangulate_keypoints(
    track: Track, keypoint_names: Sequence[str], category: Category, camera: Camera, config: ObjectConfig
) -> dict[int, tuple[Floats, Floats]]:
    """Key points of a track in the world with their covariances, by number, where the views fix them."""
    order = keypoint_order(keypoint_names, category.keypoint_names)
    seen: dict[int, list[tuple[Pose, Floats, float]]] = {}
    for detection, pose in zip(track.detections, track.world_from_camera, strict=True):
        for k, pixel, sigma in zip(*keypoints_of(detection, order, config), strict=True):
            seen.setdefault(int(k), []).append((pose, pixel, float(sigma)))
    found = {}
    for k, rays in sorted(seen.items()):
        poses, pixels, sigmas = zip(*rays, strict=True)
        point = triangulate(camera, poses, np.array(pixels), np.array(sigmas)) if len(rays) > 1 else None
        if point is not None and np.sqrt(np.linalg.eigvalsh(point[1])[-1]) < 1.0:
            found[k] = point
    return found


def pose_from_keypoints(points: dict[int, tuple[Floats, Floats]], category: Category) -> Pose | None:
    """world_from_object by Kabsch, the category's size held, wild points left out; None if fewer than 4 agree.

    Every triple gives a pose (there are at most 220); the one that most points agree with is fitted to them all.
    """
    numbers = sorted(points)
    if len(numbers) < 4:
        return None
    in_object = category.keypoints(category.vertices)[numbers]
    in_world = np.array([points[k][0] for k in numbers])
    slack = np.array([0.35 + 2 * np.sqrt(np.trace(points[k][1])) for k in numbers])
    best: tuple[int, float] = (0, np.inf)
    agreeing = np.zeros(len(numbers), bool)
    for triple in _triples(len(numbers)):
        pose = kabsch(in_world[triple], in_object[triple])
        gap = np.linalg.norm(pose.transform(in_object) - in_world, axis=1)
        near = gap < slack
        score = (int(near.sum()), float(gap[near].sum()))
        if (score[0], -score[1]) > (best[0], -best[1]):
            best, agreeing = score, near
    if best[0] < 4:
        return None
    return kabsch(in_world[agreeing], in_object[agreeing])


def _triples(count: int) -> list[list[int]]:
    return [[i, j, k] for i in range(count) for j in range(i + 1, count) for k in range(j + 1, count)]


def upright(pose: Pose, ground: GroundPlane | None) -> Pose:
    """The pose with its z axis turned onto the road's normal."""
    up = np.array([0.0, 0.0, 1.0]) if ground is None else ground.normal
    x = pose.rotation[:, 0] - up * (up @ pose.rotation[:, 0])
    if np.linalg.norm(x) < 1e-6:
        x = np.array([1.0, 0.0, 0.0])
    x = x / np.linalg.norm(x)
    return Pose(np.column_stack([x, np.cross(up, x), up]), pose.translation)


def rough_position(track: Track, category: Category, camera: Camera) -> Floats:
    """Where the object's centre is (3,): along the middle of each box, as far as the category's height makes it.

    Boxes cut by the image's edge count where there are no others.
    """
    height_m = category.dimensions[2]
    whole = [i for i, d in enumerate(track.detections) if not is_cut(d, camera, 3)]
    chosen = whole or range(len(track.detections))
    guesses, weights = [], []
    for i in chosen:
        x, y, w, h = track.detections[i].bbox
        depth_m = camera.fy * height_m / max(h, 1.0)
        ray = camera.rays(np.array([x + w / 2, y + h / 2]))
        guesses.append(track.world_from_camera[i].transform(ray * depth_m))
        weights.append(h)
    order = np.argsort(weights)[-8:]  # the tallest boxes say most
    return np.median(np.array(guesses)[order], axis=0)


def yaw_starts(position: Floats, ground: GroundPlane | None, category: Category, count: int, eye: Floats) -> list[Pose]:
    """Poses on the road around `position`: `count` headings at three distances from the camera at `eye`."""
    toward = position - eye
    starts = []
    for factor in (0.85, 1.0, 1.2):
        place = eye + toward * factor
        if ground is not None:
            place = place - ground.normal * (ground.height_m(place) - category.dimensions[2] / 2)
        headings = np.arange(count) * 2 * np.pi / count
        starts += [upright(Pose.from_yaw(float(yaw), place), ground) for yaw in headings]
    return starts


def search_poses(
    model: ObjectModel,
    views: Sequence[View],
    starts: Sequence[Pose],
    ground: GroundPlane | None,
    noise: NoiseModel,
    keep: int,
) -> list[tuple[float, Pose]]:
    """Draw the mean mesh at every start, refine the pose from the best `keep`; (cost, pose), the best first."""
    state = model.state_at(starts[0])
    overlap = model.mask_ious(views, starts, model.vertices(state)).mean(1)
    best = np.argsort(-overlap, kind="stable")[:keep]
    refined = [
        model.refine(views, ground, noise, model.state_at(starts[i]), modes=False, free_form=False, max_iterations=25)
        for i in best
    ]
    found = [(r.cost, r.state.world_from_object) for r in refined]
    return sorted(found, key=lambda pair: pair[0])


def flipped(pose: Pose) -> Pose:
    """The pose turned by half a turn about its z axis: front and rear change places."""
    return Pose(pose.rotation @ np.diag([-1.0, -1.0, 1.0]), pose.translation)
