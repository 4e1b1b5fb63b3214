"""Judgements of what is read: pure functions from data to findings with figures."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.plausibility.camera import judge_camera
    from meshslam.plausibility.finding import Finding, Severity, errors, notes, raise_errors
    from meshslam.plausibility.imu import CleanImu, clean_imu, frozen_samples, judge_imu, wild_samples
    from meshslam.plausibility.mounting import judge_mounting
    from meshslam.plausibility.poses import judge_jumps, judge_poses
    from meshslam.plausibility.rates import RatesBySight, centres, judge_rates_by_poses, judge_rates_by_sight
    from meshslam.plausibility.scale import judge_scale
    from meshslam.plausibility.sizes import judge_sizes
    from meshslam.plausibility.times import FRAME_STEP_S, SAMPLE_STEP_S, judge_times
else:
    __getattr__ = deferred(
        __name__,
        {
            "camera": "judge_camera",
            "finding": "Finding Severity errors notes raise_errors",
            "imu": "CleanImu clean_imu frozen_samples judge_imu wild_samples",
            "mounting": "judge_mounting",
            "poses": "judge_jumps judge_poses",
            "rates": "RatesBySight centres judge_rates_by_poses judge_rates_by_sight",
            "scale": "judge_scale",
            "sizes": "judge_sizes",
            "times": "FRAME_STEP_S SAMPLE_STEP_S judge_times",
        },
    )

__all__ = [
    "FRAME_STEP_S",
    "SAMPLE_STEP_S",
    "CleanImu",
    "Finding",
    "RatesBySight",
    "Severity",
    "centres",
    "clean_imu",
    "errors",
    "frozen_samples",
    "judge_camera",
    "judge_imu",
    "judge_jumps",
    "judge_mounting",
    "judge_poses",
    "judge_rates_by_poses",
    "judge_rates_by_sight",
    "judge_scale",
    "judge_sizes",
    "judge_times",
    "notes",
    "raise_errors",
    "wild_samples",
]
