"""Estimated objects against true ones."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from meshslam.categories import Category, category_names, load_category
from meshslam.evaluation.truth import Truth
from meshslam.geometry import Floats, Ints, Pose, best_pairs, voxel_iou
from meshslam.maps import Map, MapObject
from meshslam.sequences import Progress, no_progress

MATCH_DISTANCE_M = 3.0
SEEN_DETECTIONS = 5  # that show a true object that counts; fewer where no object has as many
FLIPPED_DEG = 90.0
_APART = 1e3  # cost of a pair that cannot match


@dataclass(frozen=True)
class ObjectScore:
    """One true object and the estimate that is matched to it."""

    true_id: int
    estimated_id: int
    voxel_iou: float
    category_voxel_iou: float | None  # of the category's mean mesh at the estimated pose; None: category not shipped
    centre_error_m: float
    yaw_error_deg: float  # 0 to 180


def match_objects(true_objects: Map, estimate: Map) -> list[tuple[MapObject, MapObject]]:
    """One-to-one pairs (true, estimated) with the least sum of centre distances, all within MATCH_DISTANCE_M."""
    distance = np.linalg.norm(_centres(true_objects)[:, None] - _centres(estimate)[None], axis=2)
    pairs = best_pairs(-np.where(distance > MATCH_DISTANCE_M, _APART, distance))
    return [(true_objects.objects[i], estimate.objects[j]) for i, j in pairs if distance[i, j] <= MATCH_DISTANCE_M]


def counted_objects(truth: Truth) -> set[int]:
    """True objects that count: those seen often enough; all of them where association is not known."""
    ids = {thing.id for thing in truth.objects.objects} if truth.objects is not None else set()
    if truth.object_of_annotation is None:
        return ids
    most = max((truth.detections_of(number) for number in set(truth.object_of_annotation.values())), default=0)
    return {number for number in ids if truth.detections_of(number) >= min(SEEN_DETECTIONS, most)}


def score_object(true: MapObject, estimated: MapObject) -> ObjectScore:
    """Compare two objects in the true one's frame."""
    true_from_estimated = true.world_from_object.inverse() @ estimated.world_from_object
    shipped = _category(estimated.category)
    return ObjectScore(
        true.id,
        estimated.id,
        _placed_iou(true, true_from_estimated, estimated.vertices, estimated.faces),
        None if shipped is None else _placed_iou(true, true_from_estimated, shipped.vertices, shipped.faces),
        float(np.linalg.norm(true_from_estimated.translation)),
        float(abs(np.degrees(true_from_estimated.yaw_rad))),
    )


@dataclass(frozen=True)
class ObjectScores:
    """Scores of the true objects that count: of those that are matched, and how many are not."""

    matched: tuple[ObjectScore, ...]
    missed: int
    extra: int  # estimates that match no true object

    def shape_figures(self) -> dict[str, float]:
        """`voxel_iou_mean`, and that of the category's mean mesh; a missed object has IoU 0."""
        figures = {"voxel_iou_mean": _mean_with([s.voxel_iou for s in self.matched], self.missed)}
        of_category = [s.category_voxel_iou for s in self.matched if s.category_voxel_iou is not None]
        if len(of_category) == len(self.matched):
            figures["voxel_iou_category_model"] = _mean_with(of_category, self.missed)
        return figures

    def place_figures(self) -> dict[str, float]:
        """`recall`, and medians over matched objects of the errors of centre and yaw.

        The yaw's median leaves out estimates that are turned by more than 90 degrees (front taken for rear).
        """
        figures = {"recall": len(self.matched) / (len(self.matched) + self.missed)}
        if self.matched:
            figures["centre_error_median_m"] = float(np.median([s.centre_error_m for s in self.matched]))
        straight = [s.yaw_error_deg for s in self.matched if s.yaw_error_deg < FLIPPED_DEG]
        if straight:
            figures["yaw_error_median_deg"] = float(np.median(straight))
        return figures

    def count_figures(self) -> dict[str, float]:
        """`objects_extra`, and `objects_reversed`: those that are turned by more than 90 degrees."""
        turned = sum(s.yaw_error_deg >= FLIPPED_DEG for s in self.matched)
        return {"objects_extra": self.extra, "objects_reversed": turned}


def score_objects(truth: Truth, estimate: Map, progress: Progress = no_progress) -> ObjectScores | None:
    """Score every true object that counts; None where there is none."""
    counted = counted_objects(truth)
    if truth.objects is None or not counted:
        return None
    pairs = match_objects(truth.objects, estimate)
    kept = [pair for pair in pairs if pair[0].id in counted]
    scores = []
    for done, (true, found) in enumerate(kept, 1):
        scores.append(score_object(true, found))
        progress("objects", done, len(kept))
    return ObjectScores(tuple(scores), len(counted) - len(scores), len(estimate) - len(pairs))


def object_figures(truth: Truth, estimate: Map) -> dict[str, float]:
    """The figures of metrics.json; empty where no true object counts."""
    scores = score_objects(truth, estimate)
    return {} if scores is None else scores.shape_figures() | scores.place_figures()


def _centres(objects: Map) -> Floats:
    """Centres (n, 3) of the meshes' bounding boxes, in world: loaded maps have their origins there."""
    return np.array([thing.world_from_object.translation for thing in objects.objects]).reshape(-1, 3)


def _placed_iou(true: MapObject, true_from_estimated: Pose, vertices: Floats, faces: Ints) -> float:
    return voxel_iou(true.vertices, true.faces, true_from_estimated.transform(vertices), faces)


def _mean_with(values: list[float], zeros: int) -> float:
    return sum(values) / (len(values) + zeros)


@cache
def _category(name: str) -> Category | None:
    return load_category(name) if name in category_names() else None
