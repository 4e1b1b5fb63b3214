"""Drawn meshes against the masks of a run's own detections: needs no truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshslam.errors import MapError
from meshslam.geometry import Bools, Camera, Floats, Ints, Pose, render
from meshslam.maps import Map, Trajectory
from meshslam.perception import Detection, read_detections
from meshslam.sequences import Progress, Report, no_progress, read_camera_file

Mesh = tuple[Pose, Floats, Ints]  # camera_from_object, vertices, faces
NEAR_M = 0.2  # nothing closer is taken to be drawn inside its projection
SMALLEST_PX = 40.0  # width of a box that counts


@dataclass(frozen=True)
class MaskScores:
    """How well a map explains the masks it was made from."""

    iou_of_object: dict[int, float]  # mean over the object's detections
    detections: int  # that belong to an object of the map
    eligible: int  # of the category, wide enough

    def figures(self) -> dict[str, float]:
        """`mask_iou`: the mean over objects; `mask_share_mapped`: eligible detections that belong to an object."""
        if not self.eligible:
            return {}
        ious = list(self.iou_of_object.values())
        return {
            "mask_iou": float(np.mean(ious)) if ious else 0.0,
            "mask_share_mapped": self.detections / self.eligible,
        }


def score_masks(
    run_folder: Path,
    category: str = "car",
    smallest_px: float = SMALLEST_PX,
    progress: Progress = no_progress,
    scene: Map | None = None,
    path: Trajectory | None = None,
) -> MaskScores:
    """Score a run directory: IoU of each tracked mask with its object's drawn mesh.

    `scene` and `path` are the run's, if they are read already. Pixels that a nearer mesh or another mask covers count
    only where the object's own mask is. MeshslamError, naming the file, if one is missing or damaged, or if poses and
    images do not agree in number.
    """
    camera = read_camera_file(run_folder / "camera.yaml", Report()).camera
    scene_map = Map.load(run_folder) if scene is None else scene
    path = Trajectory.load(run_folder / "trajectory.tum") if path is None else path
    by_frame = read_detections(run_folder / "detections.json").by_frame()
    if len(by_frame) != len(path):
        raise MapError(
            f"{run_folder / 'trajectory.tum'}: {len(path)} poses, but detections.json has {len(by_frame)} images"
        )
    ious: dict[int, list[float]] = {}
    eligible = 0
    for done, (found, pose) in enumerate(zip(by_frame.values(), path.world_from_camera, strict=True), 1):
        wanted = [d for d in found if d.category == category and d.bbox[2] >= smallest_px]
        eligible += len(wanted)
        for number, iou in _frame_ious(camera, pose, scene_map, found, wanted):
            ious.setdefault(number, []).append(iou)
        progress("masks", done, len(by_frame))
    means = {number: float(np.mean(values)) for number, values in sorted(ious.items())}
    return MaskScores(means, sum(map(len, ious.values())), eligible)


def _frame_ious(
    camera: Camera, world_from_camera: Pose, scene_map: Map, found: tuple[Detection, ...], wanted: list[Detection]
) -> list[tuple[int, float]]:
    """Object and IoU of each wanted detection that belongs to an object."""
    camera_from_world = world_from_camera.inverse()
    placed = {o.id: (camera_from_world @ o.world_from_object, o.vertices, o.faces) for o in scene_map.objects}
    masks = {d.id: d.mask() > 0 for d in found}
    cover = np.sum(list(masks.values()), axis=0)
    scores = []
    for d in wanted:
        own = placed.get(d.track_id) if d.track_id is not None else None
        if own is None or d.track_id is None:
            continue
        x, y, width, height = rect = _surroundings(camera, own, masks[d.id])
        part = np.s_[y : y + height, x : x + width]
        nearer = [mesh for mesh in placed.values() if mesh[0].translation[2] < own[0].translation[2]]
        mask, drawn = masks[d.id][part], render(camera, [own], rect).mask > 0
        hidden = (cover[part] > mask) | (render(camera, nearer, rect).mask > 0)
        scores.append((d.track_id, _iou(mask, drawn, ~hidden | mask)))
    return scores


def _surroundings(camera: Camera, mesh: Mesh, mask: Bools) -> tuple[int, int, int, int]:
    """A rectangle (x, y, width, height) of the image that holds a drawn mesh and a mask."""
    points = mesh[0].transform(mesh[1])
    if points[:, 2].min() < NEAR_M or not mask.any():
        return 0, 0, camera.width, camera.height
    rows, columns = np.nonzero(mask)
    pixels = np.concatenate([camera.project(points), np.column_stack([columns, rows])])
    x0, y0 = np.clip(np.floor(pixels.min(axis=0)), 0, [camera.width, camera.height]).astype(int).tolist()
    x1, y1 = np.clip(np.ceil(pixels.max(axis=0)) + 1, 0, [camera.width, camera.height]).astype(int).tolist()
    return x0, y0, x1 - x0, y1 - y0


def _iou(mask: Bools, drawn: Bools, counts: Bools) -> float:
    both, either = (mask & drawn & counts).sum(), ((mask | drawn) & counts).sum()
    return float(both / max(1, either))
