"""A run in steps, each of them in a process of its own if that is wanted: the run directory hands on what was found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from meshslam.runs import map_run, slam_run, stages
from meshslam.runs.clock import Clock
from meshslam.runs.config import Config
from meshslam.runs.judging import judge_recording, say
from meshslam.runs.localize_run import run_localize
from meshslam.runs.outlet import Outlet
from meshslam.runs.perception import by_colour, follow, given_detections, perceive
from meshslam.sequences import Sequence

DETECT = "detect"  # the first step
TRACK = "track"  # the second, where a network looks at images
RUNS: dict[str, Callable[..., dict[str, float]]] = {  # by command
    "map": map_run.run_map,
    "localize": run_localize,
    "slam": slam_run.run_slam,
}


@dataclass(frozen=True)
class Step:
    """What a step of a run gave: the steps that are left, and the figures of a run that is complete."""

    left: tuple[str, ...]
    figures: dict[str, float] | None = None
    was_there: bool = False  # the run was complete before


def run_step(
    step: str, command: str, settings: Config, out: Path, outlet: Outlet, *, overwrite: bool, clock: Clock | None = None
) -> Step:
    """Do one step of a run: `detect` first, then what the step before says is left, the last being the command itself.

    All steps together write what the command writes, to the same bytes. Errors are those of the command.
    """
    if step == command:
        return Step((), RUNS[command](settings, out, outlet, overwrite=overwrite, clock=clock))
    with stages.begin(command, settings, out, outlet, overwrite=overwrite) as begun:
        if begun.figures is not None:
            return Step((), begun.figures, was_there=True)
        recording = _prepared(command, begun.recording, settings, outlet)
        if not _takes_steps(recording, settings):
            return Step((command,))
        seen = perceive(recording, settings, outlet, begun.run).detections
        if step == DETECT:
            return Step((command,) if command == "localize" else (TRACK, command))
        seen_by = slam_run.without_poses(recording, settings) if command == "slam" else recording
        follow(seen_by, seen, settings, outlet, begun.run)
    return Step((command,))


def _prepared(command: str, recording: Sequence, settings: Config, outlet: Outlet) -> Sequence:
    """The recording as the command takes it; what cannot be right is an error."""
    if command == "map":
        return map_run.prepared(recording, outlet)
    if command == "slam":
        return slam_run.prepared(recording, settings, outlet)
    recording, findings = judge_recording(recording, poses=False, imu=True)
    say(findings, outlet)
    return recording


def _takes_steps(recording: Sequence, settings: Config) -> bool:
    """Whether a network looks at whole frames: its detections are kept, all else is made by the last step."""
    given = given_detections(recording, settings)
    return not settings.live.enabled and not by_colour(settings) and given is None
