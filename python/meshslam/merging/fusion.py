"""One car of its estimates in several drives: pose and shape weighted by their information."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from meshslam.geometry import Bools, Floats, Pose
from meshslam.maps import MapObject
from meshslam.merging.config import MergingConfig
from meshslam.merging.drives import Drive
from meshslam.merging.laying import LaidComponent
from meshslam.merging.places import HALF_TURN, Place, own_covariance, pose_of

_UNKNOWN_SIGMA_M = 0.1  # of a vertex whose sigma no run tells


@dataclass(frozen=True, eq=False)
class Estimates:
    """One car as its drives have it, in the common world, with the heading that they agree on."""

    drives: tuple[int, ...]
    things: tuple[MapObject, ...]
    world_from_object: tuple[Pose, ...]
    turned: tuple[bool, ...]  # a drive took it the wrong way round: its mesh tells front for rear

    @staticmethod
    def of(drives: Sequence[Drive], laid: LaidComponent, place: Place) -> Estimates:
        """Those of a place."""
        members = tuple(sorted(place.members))
        turned = tuple(drive in place.turned for drive in members)
        poses = (pose_of(drives, laid.aligned, drive, place.members[drive]) for drive in members)
        upright = tuple(p @ HALF_TURN if t else p for p, t in zip(poses, turned, strict=True))
        return Estimates(members, tuple(drives[d].map[place.members[d]] for d in members), upright, turned)


def fused(number: int, drives: Sequence[Drive], laid: LaidComponent, place: Place, config: MergingConfig) -> MapObject:
    """The car of a place, its pose with the drive's own uncertainty where it lies; one drive's stays as it is."""
    seen = Estimates.of(drives, laid, place)
    pose, covariance = fused_pose(laid, place, seen, config)
    usable = [thing for thing, turned in zip(seen.things, seen.turned, strict=True) if not turned]
    shapes = [thing for thing in usable if len(thing.vertices) == len(usable[0].vertices)]
    best = max(shapes, key=lambda thing: thing.views)
    vertices, sigma, observed = fused_vertices(shapes)
    names = [name for name in best.keypoints if all(name in thing.keypoints for thing in shapes)]
    points = {name: np.mean([thing.keypoints[name] for thing in shapes], axis=0) for name in names}
    made = replace(
        best,
        id=number,
        world_from_object=pose,
        vertices=vertices,
        views=sum(thing.views for thing in seen.things),
        first_frame=None,  # numbers of frames are a drive's own: visits.json has them
        last_frame=None,
        mask_iou=fused_mask_iou(seen),
        keypoints=points if len(shapes) > 1 else best.keypoints,
        pose_covariance=covariance,
        vertex_sigma_m=sigma,
        vertex_observed=observed,
    )
    return made.recentred()


def fused_pose(laid: LaidComponent, place: Place, seen: Estimates, config: MergingConfig) -> tuple[Pose, Floats]:
    """world_from_object and its covariance (6, 6): the graph's, or of one drive its own and how that drive lies."""
    if len(place.members) > 1:
        number = laid.places.index(place)
        return laid.laid.world_from_object[number], laid.laid.object_covariances[number]
    [drive], [thing] = seen.drives, seen.things
    return seen.world_from_object[0], own_covariance(thing, config) + laid.aligned.of_object(
        drive, thing.world_from_object
    )


def fused_vertices(things: Sequence[MapObject]) -> tuple[Floats, Floats | None, Bools | None]:
    """Vertices (V, 3) weighted by their information, their sigmas (V,), and which a drive observed (V,).

    What a drive did not observe is the category's prior, which all drives share: it counts where none observed it, and
    once only.
    """
    if len(things) == 1 or any(thing.vertex_sigma_m is None for thing in things):
        best = max(things, key=lambda thing: thing.views)
        return best.vertices, best.vertex_sigma_m, best.vertex_observed
    sigmas = np.array([_sigmas(thing) for thing in things])
    seen = np.array([_observed(thing) for thing in things])
    any_seen: Bools = np.asarray(seen.any(axis=0), bool)
    information = np.where(seen | ~any_seen, sigmas**-2.0, 0.0)
    weights = information / information.sum(0)
    vertices = np.einsum("kv,kvc->vc", weights, np.array([thing.vertices for thing in things]))
    sigma = np.where(any_seen, information.sum(0) ** -0.5, sigmas.min(0))
    return vertices, sigma, any_seen


def _sigmas(thing: MapObject) -> Floats:
    found = np.full(len(thing.vertices), _UNKNOWN_SIGMA_M) if thing.vertex_sigma_m is None else thing.vertex_sigma_m
    kept: Floats = np.maximum(found, 1e-4)
    return kept


def _observed(thing: MapObject) -> Bools:
    return np.ones(len(thing.vertices), bool) if thing.vertex_observed is None else thing.vertex_observed


def fused_mask_iou(seen: Estimates) -> float | None:
    """Mean over the drives' views."""
    known = [(thing.mask_iou, max(1, thing.views)) for thing in seen.things if thing.mask_iou is not None]
    return sum(iou * views for iou, views in known) / sum(views for _, views in known) if known else None
