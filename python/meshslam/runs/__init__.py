"""Configuration and stages of a run: what the command line, notebooks and services call."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.runs.api import evaluate, localize, map_drive, merge, slam
    from meshslam.runs.clock import Clock, peak_memory_mb
    from meshslam.runs.commands import users, uses
    from meshslam.runs.comparing import compare_cars, compare_runs
    from meshslam.runs.config import Config, InputConfig
    from meshslam.runs.evaluating import Measurable, read_material
    from meshslam.runs.judging import check_recording
    from meshslam.runs.localize_run import run_localize
    from meshslam.runs.map_notes import heading_notes
    from meshslam.runs.map_run import map_recording, run_map
    from meshslam.runs.merge_run import run_merge
    from meshslam.runs.notes import imu_notes, object_notes, scale_notes
    from meshslam.runs.opening import open_input
    from meshslam.runs.other_formats import export_run
    from meshslam.runs.outlet import Outlet
    from meshslam.runs.perception import segment_frames, with_keypoints
    from meshslam.runs.report import save_localization_report, save_map_report
    from meshslam.runs.settings import configured, overlaid, read_config, read_yaml, to_yaml
    from meshslam.runs.slam_run import run_slam
    from meshslam.runs.stages import metrics_json
    from meshslam.runs.steps import DETECT, RUNS, TRACK, Step, run_step
    from meshslam.runs.truth import paths_against_truth
else:
    __getattr__ = deferred(
        __name__,
        {
            "api": "evaluate localize map_drive merge slam",
            "clock": "Clock peak_memory_mb",
            "commands": "users uses",
            "comparing": "compare_cars compare_runs",
            "config": "Config InputConfig",
            "evaluating": "Measurable read_material",
            "judging": "check_recording",
            "localize_run": "run_localize",
            "map_run": "map_recording run_map",
            "merge_run": "run_merge",
            "map_notes": "heading_notes",
            "notes": "imu_notes object_notes scale_notes",
            "opening": "open_input",
            "other_formats": "export_run",
            "outlet": "Outlet",
            "perception": "segment_frames with_keypoints",
            "report": "save_localization_report save_map_report",
            "settings": "configured overlaid read_config read_yaml to_yaml",
            "slam_run": "run_slam",
            "stages": "metrics_json",
            "steps": "DETECT RUNS TRACK Step run_step",
            "truth": "paths_against_truth",
        },
    )

__all__ = [
    "DETECT",
    "RUNS",
    "TRACK",
    "Clock",
    "Config",
    "InputConfig",
    "Measurable",
    "Outlet",
    "Step",
    "check_recording",
    "compare_cars",
    "compare_runs",
    "configured",
    "evaluate",
    "export_run",
    "heading_notes",
    "imu_notes",
    "localize",
    "map_drive",
    "map_recording",
    "merge",
    "metrics_json",
    "object_notes",
    "open_input",
    "overlaid",
    "paths_against_truth",
    "peak_memory_mb",
    "read_config",
    "read_material",
    "read_yaml",
    "run_localize",
    "run_map",
    "run_merge",
    "run_slam",
    "run_step",
    "save_localization_report",
    "save_map_report",
    "scale_notes",
    "segment_frames",
    "slam",
    "to_yaml",
    "users",
    "uses",
    "with_keypoints",
]
