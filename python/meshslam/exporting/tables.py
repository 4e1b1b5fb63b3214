"""A run as two tables: its objects and its poses, a column a number."""

from __future__ import annotations

from typing import Any

import numpy as np

from meshslam.exporting.finished_run import FinishedRun
from meshslam.geometry import AnyArray, quaternions_of_rotations
from meshslam.maps import MapObject

Columns = dict[str, list[Any]]
_AXES = ("x", "y", "z")


def object_table(run: FinishedRun) -> Columns:
    """A row for each object: number, category, pose, yaw, size, views, what is known of its accuracy; metres, degrees.

    What is not known is None.
    """
    rows = [_object_row(thing) for thing in run.scene.objects]
    names = list(_object_row_names())
    return {name: [row[name] for row in rows] for name in names}


def _object_row_names() -> tuple[str, ...]:
    quaternion = tuple(f"q{axis}" for axis in (*_AXES, "w"))
    place = (*(f"{axis}_m" for axis in _AXES), *quaternion, "yaw_deg", "length_m", "width_m", "height_m")
    seen = ("views", "first_frame", "last_frame", "mask_iou", "observed_share")
    sigmas = (*(f"sigma_{axis}_m" for axis in ("forward", "left", "up")), "sigma_yaw_deg", "surface_sigma_median_m")
    return ("id", "category", *place, *seen, *sigmas, "mesh_vertices", "mesh_faces")


def _object_row(thing: MapObject) -> dict[str, Any]:
    pose, covariance = thing.world_from_object, thing.pose_covariance
    values: list[Any] = [thing.id, thing.category, *_plain(pose.translation)]
    values += _plain(quaternions_of_rotations(pose.rotation[None])[0])
    values += [float(np.degrees(np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0]))), *_plain(thing.dimensions)]
    observed = None if thing.vertex_observed is None else float(np.mean(thing.vertex_observed))
    values += [thing.views, thing.first_frame, thing.last_frame, thing.mask_iou, observed]
    sigmas: list[float | None] = [None] * 4
    if covariance is not None:
        roots = np.sqrt(np.diag(covariance))
        sigmas = [*_plain(roots[:3]), float(np.degrees(roots[5]))]
    surface = None if thing.vertex_sigma_m is None else float(np.median(thing.vertex_sigma_m))
    values += [*sigmas, surface, len(thing.vertices), len(thing.faces)]
    return dict(zip(_object_row_names(), values, strict=True))


def trajectory_table(run: FinishedRun) -> Columns:
    """A row for each pose of the camera: time, frame, position, quaternion, and where known sigmas and velocity."""
    poses = run.path.world_from_camera
    rotations = np.array([pose.rotation for pose in poses]).reshape(-1, 3, 3)
    turns = quaternions_of_rotations(rotations) if poses else np.zeros((0, 4))
    table: Columns = {"time_s": _plain(run.path.times_s), "frame": list(run.frame_ids)}
    table |= {f"{axis}_m": _plain(run.path.positions_in_world[:, i]) for i, axis in enumerate(_AXES)}
    table |= {f"q{axis}": _plain(turns[:, i]) for i, axis in enumerate((*_AXES, "w"))}
    if run.estimate is not None:
        table["position_sigma_m"] = _plain(run.estimate.position_sigmas_m)
        table["rotation_sigma_deg"] = _plain(np.degrees(run.estimate.rotation_sigmas_rad))
        velocity = run.estimate.velocity_in_world
        table |= {f"v{axis}_m_s": _plain(velocity[:, i]) for i, axis in enumerate(_AXES)}
        table["source"] = list(run.estimate.sources)
        table["extrapolated"] = [bool(value) for value in run.estimate.extrapolated]
    return table


def _plain(values: AnyArray) -> list[Any]:
    rounded: list[Any] = (np.round(np.asarray(values, float), 9) + 0.0).tolist()
    return rounded
