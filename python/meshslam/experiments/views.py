"""Shape against the number of views (paper, Sec. V-A: "mask and 3-D voxel IoU with different numbers of views")."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from meshslam.experiments.left_out import Instance, left_out_instances
from meshslam.experiments.page import Claim, Experiment, Picture, png
from meshslam.geometry import Bytes, Camera, Floats, Pose, voxel_iou
from meshslam.mapping import MappingConfig, map_objects
from meshslam.maps import CameraPath, MapObject
from meshslam.objects import ObjectConfig
from meshslam.perception import ColourConfig, ColourSegmenter, DetectionSet, detect
from meshslam.settings import Settings, setting
from meshslam.simulation import Car, Road, Street, render_image
from meshslam.viewing import Line, line_charts, mesh_picture

CAMERA = Camera(960, 400, 721.5, 721.5, 479.5, 160.0)
SOLVERS: dict[str, Literal["residuals", "gradient"]] = {"default": "residuals", "paper's": "gradient"}
STYLES: dict[str, Literal["-", "--", ":"]] = {"default": "-", "paper's": "--"}
PAPER_IOU_3_VIEWS, PAPER_MEAN_MESH = 0.8, 0.63
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class ViewsConfig(Settings):
    """The cameras stand evenly on a ring; n of the `ring` places are used."""

    seed: int = setting(0, low=0)
    kinds: tuple[str, ...] = setting(("saloon", "hatch", "box", "fastback"))
    views: tuple[int, ...] = setting(tuple(range(1, 13)), low=1)
    paper_views: tuple[int, ...] = setting(tuple(range(1, 13)), low=1)  # with the paper's solver
    ring: int = setting(12, low=1)
    radius_m: float = setting(7.0, above=0)
    height_m: float = setting(1.65, above=0)
    family: int = setting(120, low=1)  # cars that the shape space is made of, those of the left out kind among them
    modes: int = setting(20, low=0)


@dataclass(frozen=True, eq=False)
class Result:
    """One reconstruction."""

    kind: str
    solver: str
    views: int
    mask_iou: float
    voxel_iou: float  # 0 where no object came of it
    mean_mesh_voxel_iou: float  # of the category's mean where the first estimate has put it
    found: MapObject | None


def views_experiment(config: ViewsConfig, objects: ObjectConfig, progress: Progress) -> Experiment:
    """Draw, segment, reconstruct, compare."""
    progress("shape spaces", 0, 1)
    instances = left_out_instances(config.kinds, config.seed, config.family, config.modes)
    progress("shape spaces", 1, 1)
    streets = [ring_street(instance, config) for instance in instances]
    images = [[render_image(street, i) for i in range(config.ring)] for street in streets]
    seen = [read_by_colour(pictures) for pictures in images]
    counts = {"residuals": config.views, "gradient": config.paper_views}
    jobs = [
        (instance, street, found, name, n)
        for name, solver in SOLVERS.items()
        for instance, street, found in zip(instances, streets, seen, strict=True)
        for n in counts[solver]
    ]
    results: list[Result] = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for result in pool.map(partial(_job, objects=objects, config=config), jobs):
            results.append(result)
            progress("reconstruct", len(results), len(jobs))
    return _experiment(results, instances, images, config)


def ring_street(instance: Instance, config: ViewsConfig) -> Street:
    """The car alone on a plain, in coded colours, and cameras around it."""
    road = Road(np.array([[-20.0, 0.0, 0.0], [20.0, 0.0, 0.0]]), -20.0)
    body = instance.body
    car = Car(1, body, body.looks(np.random.default_rng(config.seed)), road, 0.0, 0.0, 0.0)
    target = car.start.translation
    angles = np.radians(35.0) + 2 * np.pi * np.arange(config.ring) / config.ring
    eyes = [target + [config.radius_m * np.cos(a), config.radius_m * np.sin(a), 0.0] for a in angles]
    poses = tuple(looking_at(np.array([*eye[:2], config.height_m]), target) for eye in eyes)
    times_s: Floats = np.arange(config.ring) * np.float64(0.1)
    return Street(config.seed, CAMERA, times_s, poses, config.height_m, 4.0, road, (car,), (), "contrast")


def looking_at(eye: Floats, target: Floats) -> Pose:
    """world_from_camera at `eye` (3,), level, its axis through `target` (3,)."""
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return Pose(np.stack([right, np.cross(ahead, right), ahead], axis=1), eye)


def read_by_colour(images: Sequence[Bytes]) -> DetectionSet:
    """What the colours of a world without two alike say, true association with it."""
    return detect(enumerate(images), ColourSegmenter(ColourConfig(identities=True)))


def chosen_views(count: int, ring: int) -> list[int]:
    """`count` places spread over a ring of `ring`."""
    return [round(k * ring / count) % ring for k in range(count)]


def reconstructed(
    instance: Instance, street: Street, seen: DetectionSet, solver: str, count: int, objects: ObjectConfig
) -> Result:
    """Map the car from `count` views, and compare it with the true one."""
    views = chosen_views(count, len(street.times_s))
    poses, times_s = tuple(street.world_from_camera[i] for i in views), street.times_s[np.array(sorted(views))]
    frames = CameraPath(street.camera, tuple(views), times_s, poses, street.camera_height_m)
    kept = tuple(d for d in seen.detections if d.frame in views)
    shown = replace(seen, images=tuple(i for i in seen.images if i.id in views), detections=kept)
    chosen = replace(objects, solver=SOLVERS[solver])
    found = map_objects(frames, shown, instance.category, chosen, MappingConfig(), fixed_tracks=True)
    if not found.map.objects:
        return Result(instance.kind, solver, count, 0.0, 0.0, 0.0, None)
    thing, car = found.map.objects[0], street.cars[0]
    start = found.stages[thing.id].start.world_from_object
    true_from_world = car.start.inverse()

    def overlap(pose: Pose, vertices: Floats) -> float:
        placed = (true_from_world @ pose).transform(vertices)
        return voxel_iou(car.vertices, car.faces, placed, instance.category.faces)

    own, mean = overlap(thing.world_from_object, thing.vertices), overlap(start, instance.category.vertices)
    return Result(instance.kind, solver, count, float(thing.mask_iou or 0.0), own, mean, thing)


def _job(job: tuple[Instance, Street, DetectionSet, str, int], objects: ObjectConfig, config: ViewsConfig) -> Result:
    instance, street, seen, solver, count = job
    return reconstructed(instance, street, seen, solver, count, objects)


def _experiment(
    results: list[Result], instances: list[Instance], images: list[list[Bytes]], config: ViewsConfig
) -> Experiment:
    aligned = {
        i.kind: voxel_iou(i.body.vertices, i.body.faces, i.category.vertices, i.category.faces) for i in instances
    }
    claims = [Claim("mean mesh, voxel IoU (centres aligned)", PAPER_MEAN_MESH, float(np.mean(list(aligned.values()))))]
    for name in SOLVERS:
        for n in (3, 8):
            claims.append(
                Claim(
                    f"voxel IoU from {n} views, {name} solver",
                    f"over {PAPER_IOU_3_VIEWS}" if n == 3 and name != "default" else None,
                    mean_of(results, name, n),
                )
            )
    return Experiment(
        name="views",
        title="Shape against the number of views",
        text="Cars in coded colours on a ring of cameras; masks and key points are read from the pixels. "
        "Each car's kind (its rear end) is left out of the shape space that it is estimated with.",
        claims=claims,
        rows=[
            {
                "instance": r.kind,
                "solver": r.solver,
                "views": r.views,
                "mask_iou": round(r.mask_iou, 4),
                "voxel_iou": round(r.voxel_iou, 4),
                "mean_mesh_voxel_iou": round(r.mean_mesh_voxel_iou, 4),
            }
            for r in results
        ],
        summary={"seed": config.seed, "mean_mesh_aligned_voxel_iou": round(float(np.mean(list(aligned.values()))), 4)},
        pictures=[*_charts(results, config), *_pictures(results, instances, images)],
    )


def mean_of(results: Sequence[Result], solver: str, count: int) -> float | None:
    """Mean voxel IoU over the instances; None where it was not measured."""
    values = [r.voxel_iou for r in results if r.solver == solver and r.views == count]
    return float(np.mean(values)) if values else None


def _charts(results: list[Result], config: ViewsConfig) -> list[Picture]:
    charts: dict[str, list[Line]] = {"mask IoU": [], "voxel IoU": []}
    for solver in SOLVERS:
        for colour, kind in enumerate(config.kinds):
            found = [r for r in results if r.solver == solver and r.kind == kind]
            n = [r.views for r in found]
            charts["mask IoU"].append(Line(f"{kind}, {solver}", n, [r.mask_iou for r in found], STYLES[solver], colour))
            charts["voxel IoU"].append(
                Line(f"{kind}, {solver}", n, [r.voxel_iou for r in found], STYLES[solver], colour)
            )
    for colour, kind in enumerate(config.kinds):
        found = [r for r in results if r.solver == "default" and r.kind == kind]
        mean = [r.mean_mesh_voxel_iou for r in found]
        charts["voxel IoU"].append(Line(f"{kind}, mean mesh", [r.views for r in found], mean, ":", colour))
    caption = "Mask IoU over the views used, and voxel IoU with the true car, over the number of views."
    return [
        Picture("views.svg", caption, line_charts(charts, "views", "IoU", "svg")),
        Picture("views.png", caption, line_charts(charts, "views", "IoU", "png")),
    ]


def _pictures(results: list[Result], instances: list[Instance], images: list[list[Bytes]]) -> list[Picture]:
    small = [[image[::3, ::3] for image in row] for row in images]
    rows = [np.hstack(row[k : k + 6]) for row in small for k in range(0, len(row), 6)]
    sheet = np.vstack([row for row in rows if row.shape == rows[0].shape])
    columns = []
    for instance in instances:
        extent = 1.15 * float(np.ptp(instance.body.vertices, axis=0).max())
        column = [mesh_picture(instance.body.vertices, instance.body.faces, "three quarters", extent, "true")]
        for solver in SOLVERS:
            for count in (3, 8):
                same = [r for r in results if (r.kind, r.solver, r.views) == (instance.kind, solver, count)]
                if same and same[0].found is not None:
                    mesh, label = same[0].found, f"{solver}, {count} views: {same[0].voxel_iou:.3f}"
                    column.append(mesh_picture(mesh.vertices, mesh.faces, "three quarters", extent, label))
        columns.append(column)
    deep = max(map(len, columns))
    blank = np.full_like(columns[0][0], 255)
    meshes = np.hstack([np.vstack(column + [blank] * (deep - len(column))) for column in columns])
    return [
        Picture("cameras.png", "The views, and the colours that masks and key points are read from.", png(sheet)),
        Picture("meshes.png", "True cars above, estimated ones below with their voxel IoU.", png(meshes)),
    ]
