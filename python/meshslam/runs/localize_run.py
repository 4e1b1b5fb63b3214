"""`localize`: the camera's path in a map of meshes."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

from meshslam.errors import MapError
from meshslam.evaluation import evaluate_run
from meshslam.localization import Localization, LocalizedFrame, localize_sequence
from meshslam.maps import Map, RunDirectory, TiledMap, Trajectory
from meshslam.motion import check_imu
from meshslam.object_slam import SlamLocalMapping, SlamParts
from meshslam.runs import stages
from meshslam.runs.clock import Clock
from meshslam.runs.config import Config
from meshslam.runs.judging import judge_map, judge_recording, judge_sight, say
from meshslam.runs.left_out import save_refused_views
from meshslam.runs.logged_run import LoggedRun, log_run_directory
from meshslam.runs.notes import imu_notes, object_notes
from meshslam.runs.outlet import Outlet
from meshslam.runs.perception import perceive
from meshslam.runs.report import save_localization_report
from meshslam.runs.truth import paths_against_truth
from meshslam.sequences import Sequence, camera_yaml


def localize_recording(
    recording: Sequence,
    scene: Map | TiledMap,
    settings: Config,
    outlet: Outlet,
    clock: Clock,
    run: RunDirectory | None = None,
) -> Localization:
    """Judge, perceive, localize; of a map in tiles only those around the camera are read."""
    recording, findings = judge_recording(recording, poses=False, imu=True)
    judged = judge_map(scene, settings.input.map or "the map") if isinstance(scene, Map) else []
    say(findings + judged, outlet)
    check_imu(recording, settings.estimation.imu)  # before an hour of images is looked at
    logged = LoggedRun.begin(recording, outlet)
    if isinstance(scene, Map):
        logged.objects(scene.objects)
    with clock.timing("perception"):
        found = perceive(recording, settings, outlet, run, logged.perceived).detections
    say(judge_sight(recording, found), outlet)
    for note in imu_notes(recording, settings.estimation.imu) + object_notes(recording, found):
        outlet.note(note)
    by_frame = found.by_frame()

    def on_frame(placed: LocalizedFrame) -> None:
        frame = recording.frame_ids[placed.index]
        shown = [replace(d, track_id=placed.object_of_detection.get(d.id)) for d in by_frame.get(frame, ())]
        logged.estimated(frame, placed.world_from_camera, placed.covariance, shown, stage="localization")

    with clock.timing("localization"):
        given = (recording, found, scene, settings.estimation, settings.localization)
        local = partial(SlamLocalMapping, config=SlamParts(estimation=settings.estimation))
        result = localize_sequence(*given, outlet.progress, on_frame, local)
    path = Trajectory(recording.times_s, result.world_from_camera)
    logged.result(map_along(scene, path, settings), path, result.detections, result.estimate)
    return result


def map_along(scene: Map | TiledMap, path: Trajectory, settings: Config) -> Map:
    """The map, or of one in tiles the part that the camera could see."""
    reach_m = settings.localization.association.max_distance_m
    return scene if isinstance(scene, Map) else scene.along(path.positions_in_world, reach_m)


def run_localize(
    settings: Config, out: Path, outlet: Outlet, *, overwrite: bool, clock: Clock | None = None
) -> dict[str, float]:
    """Localize, save, evaluate, report, into a run directory: what is there already is not done again."""
    if settings.input.map is None:
        raise MapError("no map is named: give --map with a run, its map.json, or an objects.json")
    scene = Map.open(Path(settings.input.map), allow_outside=settings.input.allow_outside)
    with stages.begin("localize", settings, out, outlet, overwrite=overwrite) as begun:
        if begun.figures is not None:
            path = Trajectory.load(begun.run.path("trajectory.tum"))
            log_run_directory(begun, outlet, map_along(scene, path, settings))
        return begun.figures or _localize_into(begun, scene, settings, outlet, clock or Clock())


def _localize_into(
    begun: stages.Begun, scene: Map | TiledMap, settings: Config, outlet: Outlet, clock: Clock
) -> dict[str, float]:
    """The same where the run is not there yet."""
    recording, run = begun.recording, begun.run
    result = localize_recording(recording, scene, settings, outlet, clock, run)
    mounted, height = recording.imu_from_camera, recording.height_above_ground_m
    names = ("camera.yaml", "trajectory.tum", "detections.json", "left_out.json", "report.html", "metrics.json")
    run.announce(*names)
    run.save("camera.yaml", camera_yaml(recording.camera, None, mounted, height))
    path = Trajectory(recording.times_s, result.world_from_camera)
    run.save("trajectory.tum", path.to_tum())
    sigmas = stages.save_estimate(result.estimate, run, outlet)
    run.save("detections.json", stages.written(recording, result.detections))
    save_refused_views(result, run, outlet)
    paths = {"initial": result.inertial, "filtered": result.filtered}
    paths |= {f"iteration_{k:02d}": poses for k, poses in enumerate(result.iterations)}
    figures = stages.run_figures(result.figures, len(recording), clock) | sigmas
    figures |= evaluate_run(recording.root, run.folder) | paths_against_truth(recording, paths)
    drawn = {"IMU alone": result.inertial}
    seen = map_along(scene, path, settings)
    figures = save_localization_report(recording, seen, result, figures, run, drawn, clock, outlet)
    return stages.end(begun, figures, outlet)
