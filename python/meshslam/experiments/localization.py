"""Localization among known cars (paper, Sec. V-A: 70 frames, 6 cars, synchronized IMU)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from meshslam.evaluation import trajectory_figures
from meshslam.experiments.page import Cell, Claim, Experiment, Picture, png
from meshslam.geometry import Pose
from meshslam.initialization import EstimationConfig
from meshslam.localization import Localization, LocalizationConfig, localize_sequence
from meshslam.maps import Map, MapObject, Trajectory
from meshslam.perception import ColourConfig, ColourSegmenter, DetectionSet, detect
from meshslam.sequences import Sequence as Recording
from meshslam.sequences import open_sequence
from meshslam.simulation import SimulationConfig, Street, StreetConfig, simulate_street
from meshslam.viewing import Line, draw_overlay, line_charts, lines_from_above

STREET = StreetConfig(
    frames=70,
    bend_deg=12.0,
    width_px=1242,
    height_px=375,
    focal_px=721.5,
    cars_each_side=3,
    spread=True,
    moving_cars=0,
    mode="contrast",
)
PAPER_ITERATIONS, SMOOTHER_ITERATIONS = (0, 1, 2, 5, 10, 20), (1, 2, 3, 4)
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class _Paths:
    """What the solvers made of one recording."""

    truth: Trajectory
    inertial: tuple[Pose, ...]
    default: Localization
    paper: Localization
    by_iterations: dict[str, dict[int, tuple[Pose, ...]]]  # by solver and iterations a frame

    def ate_m(self, path: Sequence[Pose]) -> float:
        """Root mean square error of a path, not aligned."""
        return trajectory_figures(self.truth, Trajectory(self.truth.times_s, tuple(path)))["ate_rmse_m"]

    def errors_m(self, path: Sequence[Pose]) -> list[float]:
        """Error at each frame."""
        pairs = zip(path, self.truth.world_from_camera, strict=True)
        return [float(np.linalg.norm(a.translation - b.translation)) for a, b in pairs]


def localization_experiment(
    simulation: SimulationConfig,
    estimation: EstimationConfig,
    config: LocalizationConfig,
    folder: Path,
    progress: Progress,
) -> Experiment:
    """Draw the street into `folder`, read the colours, localize among the true cars with both solvers."""
    street = simulate_street(simulation, folder, progress)
    recording = open_sequence(folder)
    scene = known_map(street)
    seen = _seen(recording, progress)

    def localized(estimation: EstimationConfig, config: LocalizationConfig) -> Localization:
        return localize_sequence(recording, seen, scene, estimation, config, progress)

    by_smoother, by_descent = replace(config, solver="smoother"), replace(config, solver="gradient")
    default, paper = localized(estimation, by_smoother), localized(estimation, by_descent)
    smoothers = {k: replace(estimation.smoother, iterations=k) for k in SMOOTHER_ITERATIONS}
    by_iterations = {
        "paper's": {
            k: localized(estimation, replace(by_descent, gradient_iterations=k)).world_from_camera
            for k in PAPER_ITERATIONS
        },
        "default": {
            k: localized(replace(estimation, smoother=smoother), by_smoother).world_from_camera
            for k, smoother in smoothers.items()
        },
    }
    truth = Trajectory(street.times_s, street.world_from_camera)
    paths = _Paths(truth, default.inertial, default, paper, by_iterations)
    return _experiment(paths, street, scene, recording, seen, simulation)


def known_map(street: Street) -> Map:
    """The parked cars as they are."""
    return Map(
        tuple(
            MapObject(car.id, car.category, car.start, car.vertices, car.faces, keypoints=car.keypoints)
            for car in street.cars
            if not car.moves
        )
    )


def _seen(recording: Recording, progress: Progress) -> DetectionSet:
    frames = ((frame, recording.read_image(i)) for i, frame in enumerate(recording.frame_ids))
    segmenter = ColourSegmenter(ColourConfig(identities=True))
    return detect(frames, segmenter, lambda frame: progress("segment", frame + 1, len(recording)))


def _experiment(
    paths: _Paths, street: Street, scene: Map, recording: Recording, seen: DetectionSet, simulation: SimulationConfig
) -> Experiment:
    inertial, paper = paths.ate_m(paths.inertial), paths.ate_m(paths.paper.world_from_camera)
    default = paths.ate_m(paths.default.world_from_camera)
    truth = np.array([pose.translation for pose in street.world_from_camera])
    way_m = float(np.linalg.norm(np.diff(truth, axis=0), axis=1).sum())
    rows: list[dict[str, Cell]] = [
        {"solver": solver, "iterations": k, "ate_rmse_m": round(paths.ate_m(path), 5)}
        for solver, found in paths.by_iterations.items()
        for k, path in found.items()
    ]
    imu = "recorded" if simulation.imu else "simulated"
    return Experiment(
        name="localization",
        title="Localization among known cars",
        text=f"{len(recording)} drawn frames over {way_m:.0f} m, {len(scene)} known cars, {imu} IMU; masks and key "
        "points are read from the pixels. The paper gives no figures, only that the error of the IMU is reduced.",
        claims=[
            Claim("frames", 70, len(recording)),
            Claim("known cars", 6, len(scene)),
            Claim("ATE of the IMU alone, m", None, inertial),
            Claim("ATE, paper's solver, m", "below the IMU's", paper),
            Claim("ATE, default solver, m", None, default),
        ],
        rows=rows,
        summary={
            "seed": street.seed,
            "imu": imu,
            "way_m": round(way_m, 3),
            "ate_initial_rmse_m": round(inertial, 5),
            "ate_paper_rmse_m": round(paper, 5),
            "ate_default_rmse_m": round(default, 5),
        },
        pictures=[*_charts(paths, scene), _picture(recording, seen, scene, street)],
    )


def _charts(paths: _Paths, scene: Map) -> list[Picture]:
    named = {
        "truth": paths.truth.world_from_camera,
        "IMU alone": paths.inertial,
        "paper's solver": paths.paper.world_from_camera,
        "default": paths.default.world_from_camera,
    }
    above = lines_from_above(scene, named)
    numbers = list(range(len(paths.truth)))
    over_frames = [Line(name, numbers, paths.errors_m(path)) for name, path in named.items() if name != "truth"]
    over_iterations = [
        Line(solver, list(found), [paths.ate_m(path) for path in found.values()])
        for solver, found in paths.by_iterations.items()
    ]
    wanted = (
        ("path", {"from above": above}, "x, m", "y, m", "The path among the cars, from above."),
        ("error", {"error of the camera's place": over_frames}, "frame", "m", "Error at each frame."),
        ("iterations", {"ATE": over_iterations}, "iterations a frame", "m", "ATE over the iterations of each frame."),
    )
    return [
        Picture(
            f"{name}.{kind}",
            caption,
            line_charts(charts, x, y, kind, equal=name == "path", logarithmic=name == "iterations"),
        )
        for name, charts, x, y, caption in wanted
        for kind in ("svg", "png")
    ]


def _picture(recording: Recording, seen: DetectionSet, scene: Map, street: Street) -> Picture:
    by_frame = seen.by_frame()
    best = max(by_frame, key=lambda frame: sum(d.area_px for d in by_frame[frame]))
    image = recording.read_image(recording.frame_ids.index(best))
    pose = street.world_from_camera[recording.frame_ids.index(best)]
    drawn = draw_overlay(image, recording.camera, pose, scene, by_frame[best])
    return Picture(
        "frame.png", f"Frame {best} as it is drawn, and what is read from it.", png(np.vstack([image, drawn]))
    )
