"""Known camera poses against images, road and cars: wrong lengths of steps are corrected.

Tracked points fix the ratios of consecutive steps to half a percent. Where given lengths contradict them, most of the
given ones tell the unit of the others. Where too few are right, the road's texture tells it, and the sizes of cars must
agree. Right poses are not touched.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import pairwise, repeat

import numpy as np

from meshslam.features.image_features import FrameImage
from meshslam.features.image_path import image_path, step_lengths_m
from meshslam.features.length_config import LengthConfig
from meshslam.features.length_evidence import LogFactor, road_factor
from meshslam.features.length_judgement import Correction, Stretch, judge_stretch, judge_unit, scaled
from meshslam.features.point_tracks import PointConfig, PointTracker, free_mask
from meshslam.features.road_displacement import RoadConfig
from meshslam.geometry import Bytes, Floats, Pose
from meshslam.maps import CameraPath
from meshslam.perception import Detection, grey

_MIN_STEPS = 3  # fewer have hardly a ratio to be judged by

SizesOf = Callable[[CameraPath], LogFactor | None]  # of true over given lengths of a path, by the sizes of cars
ReadImage = Callable[[int], Bytes]


@dataclass(frozen=True, eq=False)
class Lengths:
    """The path with right lengths, and what the user should know of it."""

    frames: CameraPath
    notes: tuple[str, ...]


def correct_lengths(
    frames: CameraPath,
    read_image: ReadImage,
    detections_of_frame: Mapping[int, tuple[Detection, ...]],
    config: LengthConfig,
    sizes: SizesOf,
    progress: Callable[[str, int, int], None] | None = None,
) -> Lengths:
    """The same path; where its lengths are wrong beyond doubt, with the right ones. `read_image` takes an index."""
    stretches: list[Stretch] = []
    corrections: list[Correction] = []
    for first, last in parts(step_lengths_m(frames.world_from_camera), config):
        stretch = _stretch(frames, first, last, read_image, detections_of_frame, config)
        if stretch is not None:
            found = judge_stretch(stretch, _of_part(frames, first, last, sizes))
            stretches += [stretch] if stretch.is_right or stretch.tells_unit else []
            corrections += [found] if found is not None else []
        if progress is not None:
            progress("lengths", last + 1, len(frames.frame_ids))
    poses, notes = _moved(frames.world_from_camera, corrections), [found.note for found in corrections]
    whole = judge_unit(stretches, poses, _of_part(frames, 0, len(poses) - 1, sizes))
    if whole is not None:
        factor, note = whole
        notes.append(note)
        poses = poses if factor == 1.0 else scaled(poses, float(np.round(np.log(factor), 9)))
    return Lengths(replace(frames, world_from_camera=poses), tuple(notes))


def parts(lengths_m: Floats, config: LengthConfig) -> list[tuple[int, int]]:
    """First and last frames of the parts that are judged one by one: the camera moves, and they are not too long."""
    moves = np.concatenate([[False], lengths_m >= config.min_step_m, [False]])
    begins, ends = np.flatnonzero(moves[1:] & ~moves[:-1]), np.flatnonzero(moves[:-1] & ~moves[1:])
    found = []
    for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
        count = -(-(end - begin) // config.steps)
        cuts = np.linspace(begin, end, count + 1).round().astype(int).tolist()
        found += [(a, b) for a, b in pairwise(cuts) if b - a >= _MIN_STEPS]
    return found


def _stretch(
    frames: CameraPath,
    first: int,
    last: int,
    read_image: ReadImage,
    detections_of_frame: Mapping[int, tuple[Detection, ...]],
    config: LengthConfig,
) -> Stretch | None:
    """Points and road of a part of the path; None where points do not hold it."""
    given, points = frames.world_from_camera[first : last + 1], PointConfig(corners=config.points)
    trackers = [PointTracker(points, row) for row in range(points.rows)]
    seen, blocks = [], {}
    with ThreadPoolExecutor(max_workers=len(trackers)) as pool:
        for i in range(first, last + 1):
            image = grey(read_image(i))
            free = free_mask(image.shape, detections_of_frame[frames.frame_ids[i]], points)
            tracked = pool.map(PointTracker.step, trackers, repeat(image), repeat(free))
            blocks.update({(block.row, block.first): block for block in tracked})
            seen.append(FrameImage(image, free))
    found = image_path(frames.camera, given, list(blocks.values()), points)
    if found is None:
        return None
    height, road = frames.height_above_ground_m, None
    if height is not None:
        baseline = RoadConfig(min_baseline_m=config.road_baseline_m)
        road = road_factor(seen, found.world_from_camera, frames.camera, height, config.road_share, baseline)
    return Stretch(first, last, given, found, road, config)


def _of_part(frames: CameraPath, first: int, last: int, sizes: SizesOf) -> Callable[[Sequence[Pose]], LogFactor | None]:
    """The sizes of cars along other poses of some of the frames."""
    part = slice(first, last + 1)
    ids, times = frames.frame_ids[part], frames.times_s[part]
    return lambda poses: sizes(replace(frames, frame_ids=ids, times_s=times, world_from_camera=tuple(poses)))


def _moved(given: tuple[Pose, ...], corrections: Sequence[Correction]) -> tuple[Pose, ...]:
    """The path with new displacements; what follows a step moves with it."""
    shifts = np.zeros((len(given), 3))
    for one in corrections:
        if one.displacements_m is None:
            continue
        for k, moved in zip(one.steps, one.displacements_m, strict=True):
            shifts[k + 1] = moved - (given[k + 1].translation - given[k].translation)
    if not shifts.any():
        return given
    shifts = np.cumsum(shifts, axis=0)
    return tuple(
        Pose(p.rotation, p.translation + shift) if shift.any() else p for p, shift in zip(given, shifts, strict=True)
    )
