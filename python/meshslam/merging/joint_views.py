"""What several drives show of one car, in the common world."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.merging.drives import Drive, DriveViews
from meshslam.merging.laying import LaidComponent
from meshslam.merging.places import Place
from meshslam.objects import (
    Occluders,
    Placed,
    Scene,
    Track,
    TrackObservations,
    choose_views,
    make_views,
    road_points,
    with_surface_sigmas,
)

CAMERA_HEIGHT_M = 1.65  # where no run tells
_NEAREST_M = 1.0  # depth below which the surface's error grows no more


@dataclass(frozen=True, eq=False)
class JointViews:
    """Views of one car, and which drive each is of."""

    observed: TrackObservations
    drive_of_view: tuple[int, ...]

    def with_surface_error(self, scene: Scene, drives: Sequence[Drive], world_from_object: Pose) -> JointViews:
        """The same views, each with the surface's error as its drive's camera sees it from there."""
        at, sigmas = world_from_object.translation, list[float]()
        for drive, pose in zip(self.drive_of_view, self.observed.track.world_from_camera, strict=True):
            depth = max(_NEAREST_M, float(pose.inverse().transform(at)[2]))
            sigmas.append(scene.config.noise.surface_sigma_m * views_of(drives[drive]).camera.fx / depth)
        return JointViews(with_surface_sigmas(self.observed, tuple(sigmas)), self.drive_of_view)

    def shares(self) -> dict[int, float]:
        """Each drive's share of the views."""
        count = len(self.drive_of_view)
        return {drive: self.drive_of_view.count(drive) / count for drive in sorted(set(self.drive_of_view))}


def observe(
    place: Place,
    drives: Sequence[Drive],
    laid: LaidComponent,
    occluders: Mapping[int, Occluders],
    scene: Scene,
    most: int,
) -> JointViews | None:
    """A car's views of all drives, `most` of a drive; None if they are not of two drives."""
    tracks, views, owners = list[Track](), [], list[int]()
    for drive in sorted(set(place.members) & set(occluders)):
        track = _track(drives[drive], place.members[drive], laid.aligned.world_from_drive[drive])
        if track is None:
            continue
        chosen = track.subset(choose_views(track, most, scene.config))
        camera, before = views_of(drives[drive]).camera, occluders[drive].before
        made = make_views(chosen, scene.model, scene.category, scene.keypoint_names, camera, before, scene.config)
        tracks.append(chosen)
        views += made
        owners += [drive] * len(made)
    if len(tracks) < 2:
        return None
    together = Track(
        tracks[0].id,
        tuple(d for track in tracks for d in track.detections),
        tuple(pose for track in tracks for pose in track.world_from_camera),
        np.zeros(len(owners)),  # the car is parked: it has no velocity, and the drives no common clock
    )
    return JointViews(TrackObservations(together, views, together, []), tuple(owners))


def views_of(drive: Drive) -> DriveViews:
    """The views of a drive that has some."""
    if drive.views is None:
        raise ValueError(f"{drive.name} has no views")
    return drive.views


def road_of(drive: Drive, world_from_drive: Pose) -> Floats:
    """Points (n, 3) of the road below a drive's cameras, in the common world."""
    if drive.trajectory is None:
        return np.zeros((0, 3))
    poses = [world_from_drive @ pose for pose in drive.trajectory.world_from_camera]
    return road_points(poses, views_of(drive).height_above_ground_m or CAMERA_HEIGHT_M)


def occluders_of(drive: Drive) -> Occluders:
    """Who hides whom in a drive's frames, by its own map in its own world."""
    views = views_of(drive)
    placed = {o.id: Placed(o.world_from_object, o.vertices, o.faces) for o in drive.map.objects}
    return Occluders(views.camera, views.detections.by_frame(), _poses(drive), placed)


def _poses(drive: Drive) -> dict[int, Pose]:
    """drive_from_camera by frame."""
    poses = () if drive.trajectory is None else drive.trajectory.world_from_camera
    return dict(zip(views_of(drive).frame_ids, poses, strict=True))


def _track(drive: Drive, number: int, world_from_drive: Pose) -> Track | None:
    """A car's detections in a drive, with its cameras in the common world; None if it has none."""
    poses = _poses(drive)
    seen = [d for d in views_of(drive).detections.by_track().get(number, ()) if d.frame in poses]
    if not seen:
        return None
    cameras = tuple(world_from_drive @ poses[d.frame] for d in seen)
    return Track(number, tuple(seen), cameras, np.arange(len(seen), dtype=float))
