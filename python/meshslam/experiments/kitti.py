"""Real drives (paper, Sec. V-B, Table I): mask IoU of a single frame, after the pose, after the shape; marked cars."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshslam.categories import load_category
from meshslam.evaluation import MarkedScore, marked_labels, marked_objects, score_marked
from meshslam.experiments.page import Cell, Claim, Experiment, Picture, png
from meshslam.files import real_path
from meshslam.geometry import Bytes
from meshslam.maps import Map, Trajectory, read_figures
from meshslam.perception import DetectionSet, read_detections
from meshslam.sequences import Sequence as Recording
from meshslam.viewing import Line, draw_overlay, footprint, line_charts, mesh_picture

COLUMNS = {
    "mask_iou_single_frame": "single frame",
    "mask_iou_pose": "with pose",
    "mask_iou_shape": "with pose and shape",
}
OVERLAYS, SHOWN_OBJECTS = 3, 6


@dataclass(frozen=True)
class PaperRow:
    """A column of the paper's Table I."""

    frames: int
    objects: int
    ious: tuple[float, float, float]  # single image, pose, pose and shape


DRIVE_0020 = PaperRow(1101, 77, (0.641, 0.689, 0.725))
PAPER_TABLE = {
    "2011_09_26_drive_0048": PaperRow(22, 6, (0.692, 0.735, 0.778)),
    "2011_09_26_drive_0035": PaperRow(131, 28, (0.642, 0.656, 0.675)),
    "2011_09_30_drive_0020": DRIVE_0020,
    "06": DRIVE_0020,  # its name among the odometry sequences
}
PAPER_MARKED = "56 of 62"
PAPER_POSITION_ERROR_M = 1.9


@dataclass(frozen=True, eq=False)
class MappedDrive:
    """A drive and the run directory of its map."""

    recording: Recording
    run: Path
    labels: Path | None = None  # KITTI tracking labels of its cars

    @property
    def name(self) -> str:
        """As tables call it."""
        return real_path(self.recording.root).name

    @property
    def paper(self) -> PaperRow | None:
        """What the paper says of it."""
        return PAPER_TABLE.get(self.name.removesuffix("_sync").removesuffix("_extract"))


def kitti_experiment(drives: Sequence[MappedDrive]) -> Experiment:
    """Table I of mapped drives, marked cars where they are given, and pictures."""
    claims: list[Claim] = []
    rows: list[dict[str, Cell]] = []
    pictures: list[Picture] = []
    for number, drive in enumerate(drives):
        figures = read_figures(drive.run)
        scene, path = Map.load(drive.run), Trajectory.load(drive.run / "trajectory.tum")
        marked = _marked(drive, scene, path)
        claims += _claims(drive, figures, marked)
        rows.append(_row(drive, figures, marked))
        pictures += _pictures(f"drive{number}", drive, scene, path, marked)
    return Experiment(
        name="kitti",
        title="Real drives",
        text="Mask IoU over the views that were used: pose and modes from one frame, scored on it; the mean mesh after "
        "the pose step; the instance. The paper's first row is another method's, a network of Kanazawa et al.; "
        "its objects are those that its detector finds. Each drive's own report holds all frames and meshes.",
        claims=claims,
        rows=rows,
        summary={},
        pictures=pictures,
    )


def _marked(drive: MappedDrive, scene: Map, path: Trajectory) -> MarkedScore | None:
    if drive.labels is not None:
        poses = dict(zip(drive.recording.frame_ids, path.world_from_camera, strict=True))
        return score_marked(marked_labels(drive.labels, poses), scene)
    places = marked_objects(drive.recording.root)
    return None if places is None else score_marked(places, scene)


def _row(drive: MappedDrive, figures: dict[str, float], marked: MarkedScore | None) -> dict[str, Cell]:
    row: dict[str, Cell] = {"drive": drive.name, "frames": int(figures["frames"])}
    row["objects"] = int(figures["objects_mapped"])
    row |= {key: figures.get(key) for key in COLUMNS}
    found = {} if marked is None else marked.figures()
    return row | {key: found.get(key) for key in ("marked", "reconstructed", "position_error_mean_m")}


def _claims(drive: MappedDrive, figures: dict[str, float], marked: MarkedScore | None) -> list[Claim]:
    paper, name = drive.paper, drive.name
    known: list[Cell] = [None] * 5 if paper is None else [paper.frames, paper.objects, *paper.ious]
    ours: list[Cell] = [int(figures["frames"]), int(figures["objects_mapped"]), *(figures.get(k) for k in COLUMNS)]
    what = ("frames", "objects", *(f"mask IoU, {column}" for column in COLUMNS.values()))
    rows = [Claim(f"{name}: {w}", p, o) for w, p, o in zip(what, known, ours, strict=True)]
    if marked is not None:
        of_sequence = drive.paper is DRIVE_0020
        count = f"{len(marked.errors_m)} of {len(marked.positions)}"
        error = marked.figures().get("position_error_mean_m")
        rows.append(Claim(f"{name}: marked cars reconstructed", PAPER_MARKED if of_sequence else None, count))
        paper_error = PAPER_POSITION_ERROR_M if of_sequence else None
        rows.append(Claim(f"{name}: mean position error, m", paper_error, error))
    return rows


def _pictures(
    prefix: str, drive: MappedDrive, scene: Map, path: Trajectory, marked: MarkedScore | None
) -> list[Picture]:
    found = read_detections(drive.run / "detections.json")
    pictures = [
        Picture(f"{prefix}_path.{kind}", f"{drive.name}: path and cars from above.", _plan(scene, path, marked, kind))
        for kind in ("svg", "png")
    ]
    if scene.objects:
        pictures.append(Picture(f"{prefix}_meshes.png", "The mean mesh above, instances below.", png(_meshes(scene))))
    if drive.recording.images is not None:
        overlays = _overlays(drive, scene, path, found)
        pictures.append(Picture(f"{prefix}_overlays.png", "Detections and drawn meshes.", png(overlays)))
    return pictures


def _plan(scene: Map, path: Trajectory, marked: MarkedScore | None, kind: str) -> bytes:
    places = path.positions_in_world
    lines = [Line("camera", places[:, 0].tolist(), places[:, 1].tolist())]
    for thing in scene.objects:
        hull = footprint(thing)
        closed = np.concatenate([hull, hull[:1]])
        lines.append(Line("", closed[:, 0].tolist(), closed[:, 1].tolist()))
    if marked is not None:
        lines.append(Line("marked", marked.positions[:, 0].tolist(), marked.positions[:, 1].tolist(), "none"))
    return line_charts({"from above": lines}, "x, m", "y, m", "svg" if kind == "svg" else "png", equal=True)


def _meshes(scene: Map) -> Bytes:
    things = sorted(scene.objects, key=lambda thing: -thing.views)[:SHOWN_OBJECTS]
    extent = 1.15 * max(float(thing.dimensions.max()) for thing in things)
    columns = []
    for thing in things:
        mean = load_category(thing.category)
        before = mesh_picture(mean.vertices, mean.faces, "three quarters", extent, f"mean {thing.category}")
        after = mesh_picture(thing.vertices, thing.faces, "three quarters", extent, f"object {thing.id}")
        columns.append(np.vstack([before, after]))
    return np.hstack(columns)


def _overlays(drive: MappedDrive, scene: Map, path: Trajectory, found: DetectionSet) -> Bytes:
    """Frames spread over the drive, each image above what is drawn on it."""
    recording, by_frame = drive.recording, found.by_frame()
    chosen = np.linspace(0, len(recording) - 1, OVERLAYS + 2).round().astype(int)[1:-1]
    rows = []
    for index in chosen.tolist():
        image, pose = recording.read_image(index), path.world_from_camera[index]
        seen = by_frame.get(recording.frame_ids[index], ())
        rows.append(draw_overlay(image, recording.camera, pose, scene, seen))
    return np.vstack(rows)
