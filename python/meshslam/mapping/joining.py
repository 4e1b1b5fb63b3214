"""Tracks that turn out to be one object."""

from __future__ import annotations

import numpy as np

from meshslam.mapping.config import MappingConfig
from meshslam.mapping.judgement import Places
from meshslam.mapping.left_out import LeftOut
from meshslam.mapping.work import Work, first_pass, mean_iou
from meshslam.objects import Occluders, Scene, Track
from meshslam.perception import DetectionSet


def join_tracks(
    work: list[Work],
    detections: DetectionSet,
    scene: Scene,
    occluders: Occluders,
    config: MappingConfig,
    *,
    fixed_tracks: bool,
) -> tuple[DetectionSet, list[Work], list[LeftOut]]:
    """Join tracks that turn out to be one object; tracks that were given stay as they are."""
    if fixed_tracks:
        return detections, work, []
    left_out: list[LeftOut] = []
    work, places = list(work), Places(scene, config.merge_distance_m)
    while (pair := places.shared(work)) is not None:
        first, second = (work[i] for i in pair)
        seen = [len(one.observed.track.detections) for one in (first, second)]
        keep, give = (first, second) if seen[0] >= seen[1] else (second, first)
        joined, moved = _joined_track(keep, give, detections)
        trial = first_pass(joined, scene, occluders)
        fits = mean_iou(trial, scene) > mean_iou(keep, scene) - 0.05
        if fits:
            detections = detections.with_tracks(moved)
        left_out.append(
            LeftOut(
                give.observed.track.id,
                "the same object",
                f"joined with track {keep.observed.track.id}"
                if fits
                else f"stands where track {keep.observed.track.id} does",
            )
        )
        work = [w for i, w in enumerate(work) if i not in pair] + [trial if fits else keep]
        work.sort(key=lambda w: w.observed.track.id)
    return detections, work, left_out


def _joined_track(keep: Work, give: Work, detections: DetectionSet) -> tuple[Track, dict[int, int | None]]:
    """One track of two, and where each detection of the second goes; a frame that both see keeps the first's."""
    a, b = keep.observed.track, give.observed.track
    tracks = detections.by_track()
    taken = {d.frame for d in tracks[a.id]}
    moved: dict[int, int | None] = {d.id: None if d.frame in taken else a.id for d in tracks[b.id]}
    rows = [
        (d.frame, d, p, t)
        for w in (a, b)
        for d, p, t in zip(w.detections, w.world_from_camera, w.times_s, strict=True)
        if w is a or d.frame not in taken
    ]
    rows.sort(key=lambda row: row[0])
    _, seen, poses, times = zip(*rows, strict=True)
    return Track(a.id, tuple(d.with_track(a.id) for d in seen), tuple(poses), np.array(times)), moved
