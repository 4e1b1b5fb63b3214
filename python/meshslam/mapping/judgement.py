"""Which estimates are parked objects of the category, and which of them are one."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from meshslam.geometry import Floats
from meshslam.mapping.config import MappingConfig
from meshslam.mapping.left_out import LeftOut
from meshslam.mapping.work import Work, mean_iou
from meshslam.objects import Reconstruction, Scene, centred, height_over_road_m, motion

Motion = tuple[Floats, float]  # the velocity (3,) that explains the views best, and by how much the cost falls with it


def motion_of(work: Work, scene: Scene) -> Motion:
    """The motion test; none where views or times are too few for one."""
    if len(work.observed.views) < 3 or np.ptp(work.observed.track.times_s) <= 0:
        return np.zeros(3), 0.0
    return motion(work.observed, scene, work.found)


def why_unfit(
    work: Work, scene: Scene, config: MappingConfig, *, judge_shape: bool = True, moved: Motion | None = None
) -> LeftOut | None:
    """Why an estimate is no parked object of the category, if it is none; its views are there.

    `moved` is the motion test where it was made already.
    """
    track = work.observed.track
    distance = min(
        float(np.linalg.norm(pose.translation - work.found.state.world_from_object.translation))
        for pose in track.world_from_camera
    )
    if distance > config.max_distance_m:
        return LeftOut(track.id, "too far", f"{distance:.0f} m at its nearest")
    moving = _moves(work, scene, moved or motion_of(work, scene))
    if moving is not None:
        return LeftOut(track.id, "moves", moving)
    height, sigma = height_over_road_m(scene, work.found)
    if abs(height) > max(config.max_height_over_road_m, 4 * sigma):
        return LeftOut(track.id, "not on the road", f"its lowest point is {height:.2f} m over it")
    unlikely = 0.5 * float((work.found.state.z**2).sum())
    if judge_shape and unlikely > config.max_shape_cost:
        return LeftOut(track.id, "no such shape", f"costs {unlikely:.0f} in the category's shape space")
    overlap = mean_iou(work, scene)
    if overlap < config.min_mask_iou:
        return LeftOut(track.id, "does not fit its masks", f"mean mask IoU {overlap:.2f}")
    return None


def _moves(work: Work, scene: Scene, moved: Motion) -> str | None:
    """The speed, if the views agree far better with an object that drives than with one that stands."""
    velocity, gain = moved
    speed, seconds = float(np.linalg.norm(velocity[:2])), float(np.ptp(work.observed.track.times_s))
    fast = speed > scene.config.max_speed_m_s or speed * seconds > scene.config.max_way_m
    moving = fast and gain > scene.config.motion_gain
    return f"its views agree with {speed:.1f} m/s (cost lower by {gain:.0f}), not with one place" if moving else None


def without_duplicates(work: list[Work], scene: Scene, config: MappingConfig) -> tuple[list[Work], list[LeftOut]]:
    """Of two objects in one place, keep the one that is seen in more views."""
    left_out: list[LeftOut] = []
    places = Places(scene, config.merge_distance_m)
    while (pair := places.shared(work)) is not None:
        first, second = (work[i] for i in pair)
        give = second if len(first.observed.track.detections) >= len(second.observed.track.detections) else first
        keep = first if give is second else second
        where = f"stands in the place of track {keep.observed.track.id}"
        left_out.append(LeftOut(give.observed.track.id, "the same object", where))
        work = [w for w in work if w is not give]
    return work, left_out


@dataclass
class Places:
    """Where objects stand; asked again and again while some of them go or change."""

    scene: Scene
    distance_m: float  # two objects nearer than this are in one place
    _known: dict[int, tuple[Reconstruction, Floats]] = field(default_factory=dict)  # by track

    def shared(self, work: list[Work]) -> tuple[int, int] | None:
        """The first two that stand in one place."""
        places = np.array([self._of(w) for w in work]).reshape(-1, 3)
        for i, a in enumerate(places):
            roughly = np.abs(places[i + 1 :] - a).max(axis=1) < self.distance_m
            for j in (i + 1 + np.flatnonzero(roughly)).tolist():
                if float(np.linalg.norm(a - places[j])) < self.distance_m:
                    return i, j
        return None

    def _of(self, work: Work) -> Floats:
        number, found = work.observed.track.id, work.found
        if number not in self._known or self._known[number][0] is not found:
            self._known[number] = found, centred(self.scene.model, found.state).world_from_object.translation
        return self._known[number][1]
