"""Runs side by side: what is compared, and the one HTML page that shows it; it opens offline."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from string import Template

import numpy as np

from meshslam.geometry import Bytes, Floats, Pose
from meshslam.maps import Map
from meshslam.viewing.better import better_of
from meshslam.viewing.comparison_plan import LETTERS, comparison_plan, distance_chart, line_of
from meshslam.viewing.markup import UNKNOWN, asset, jpeg_uri, number, table, text
from meshslam.viewing.tables import FIGURES, describe

_SAME_M = 1e-6  # of rounding in trajectory.tum
_SHOWN_EQUAL = 1e-9  # share by which figures differ that count as the same


@dataclass(frozen=True, eq=False)
class ComparedRun:
    """One run; parts that it does not have are empty."""

    name: str
    place: str
    times_s: Floats  # (n,)
    world_from_camera: tuple[Pose, ...]
    map: Map
    figures: Mapping[str, float]
    settings: Mapping[str, object]  # by their paths, such as slam.lag_s


@dataclass(frozen=True, eq=False)
class CarPair:
    """One car in two maps, as the second differs from the first, along the first one's axes."""

    first_id: int
    other_id: int
    centre_m: Floats  # (3,), ahead, left, up
    yaw_deg: float
    size_m: Floats  # (3,), length, width, height
    iou: float  # of the meshes where they stand


@dataclass(frozen=True, eq=False)
class ComparedCars:
    """The cars of a run beside those of the first."""

    pairs: tuple[CarPair, ...]
    only_first: tuple[int, ...]
    only_other: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class OverlayFrame:
    """The same frame with each run's map drawn over it."""

    frame: int
    pictures: tuple[Bytes, ...]  # BGR, one a run


@dataclass(frozen=True, eq=False)
class Comparison:
    """Everything that the page shows; what is measured against is the first run."""

    runs: tuple[ComparedRun, ...]
    cars: tuple[ComparedCars, ...]  # of runs[1:]
    distances_m: tuple[tuple[Floats, Floats], ...]  # of runs[1:]: seconds since the start, distance between the paths
    frames: tuple[OverlayFrame, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class FigureRow:
    """One figure of every run."""

    key: str
    values: tuple[float | None, ...]
    best: frozenset[int]  # places of the runs that are better; empty where none is


def figure_rows_of(runs: Sequence[ComparedRun]) -> list[FigureRow]:
    """All figures that any run has, those of the same kind together; errors after each iteration are left out."""
    keys = {key for run in runs for key in run.figures if not key.startswith("ate_iteration_")}
    order = {key: i for i, key in enumerate(FIGURES)}
    rows = []
    for key in sorted(keys, key=lambda k: (order.get(k, len(order)), k)):
        values = tuple(run.figures.get(key) for run in runs)
        rows.append(FigureRow(key, values, _best(key, values)))
    return rows


def differing_settings(runs: Sequence[ComparedRun]) -> list[tuple[str, list[str]]]:
    """Settings that are not the same in all runs."""
    keys = sorted({key for run in runs for key in run.settings})
    rows = []
    for key in keys:
        values = [_setting(run.settings, key) for run in runs]
        if len(set(values)) > 1:
            rows.append((key, values))
    return rows


def figure_text(key: str, value: float) -> str:
    """A figure with the digits that it is shown with, and its unit."""
    shown = describe(key)
    return f"{value:.{_decimals(key, value)}f}{' ' + shown.unit if shown.unit else ''}"


def comparison_page(comparison: Comparison) -> str:
    """The page as text; pictures and script are inside."""
    runs = comparison.runs
    names = ", ".join(run.name for run in runs)
    return Template(asset("compare.html")).substitute(
        title=text(f"{len(runs)} runs: {names}"),
        style=asset("compare.css"),
        script=asset("compare.js"),
        runs=_runs(runs),
        notes="".join(f"<li>{text(note)}</li>" for note in comparison.notes),
        notes_hidden="" if comparison.notes else " hidden",
        figures=_figures(runs),
        settings=_settings(runs),
        plan=comparison_plan([(run.world_from_camera, run.map) for run in runs]),
        distances=_distances(comparison),
        cars=_cars(comparison),
        frames=_frames(comparison),
    )


def _best(key: str, values: tuple[float | None, ...]) -> frozenset[int]:
    known = {i: value for i, value in enumerate(values) if value is not None}
    better = better_of(key)
    if better is None or len(known) < 2:
        return frozenset()
    best = min(known.values()) if better == "lower" else max(known.values())
    found = {i for i, v in known.items() if abs(v - best) <= _SHOWN_EQUAL * max(1.0, abs(best))}
    return frozenset() if len(found) == len(known) else frozenset(found)


def _decimals(key: str, value: float) -> int:
    return 0 if isinstance(value, int) else describe(key).decimals


def _setting(settings: Mapping[str, object], key: str) -> str:
    return json.dumps(settings[key], ensure_ascii=False) if key in settings else "not set"


def _runs(runs: Sequence[ComparedRun]) -> str:
    """The runs with their letters and lines: the legend of the page."""
    rows = [
        f'<li><span class="letter run{i}">{LETTERS[i]}</span>{line_of(i)}<b>{text(run.name)}</b> '
        f"<small>{text(run.place)}: {len(run.world_from_camera)} poses, {len(run.map)} objects</small></li>"
        for i, run in enumerate(runs)
    ]
    return "".join(rows)


def _letters(runs: Sequence[ComparedRun]) -> list[str]:
    return [f'<span class="letter run{i}">{LETTERS[i]}</span> {text(run.name)}' for i, run in enumerate(runs)]


def _figures(runs: Sequence[ComparedRun]) -> str:
    rows, group = [], ""
    for row in figure_rows_of(runs):
        shown = describe(row.key)
        arrow = {"lower": "&darr;", "higher": "&uarr;", None: ""}[better_of(row.key)]
        narrow = f"<small class=narrow>{text(shown.group)}: </small>"
        label = f'{narrow}<span title="{text(row.key)}">{text(shown.label)}</span> <small>{arrow}</small>'
        head, group = "" if shown.group == group else f"<b>{text(shown.group)}</b>", shown.group
        rows.append([head, label, *(_cell(row, i) for i in range(len(runs)))])
    if not rows:
        return "<p class=none>No run has metrics.json.</p>"
    return table(["", "figure", *_letters(runs)], rows, "figures")


def _cell(row: FigureRow, place: int) -> str:
    value, shown = row.values[place], describe(row.key)
    if value is None:
        return UNKNOWN
    written = f"{number(value, _decimals(row.key, value))}<small> {shown.unit}</small>"
    mark = '<span class=better title="better">&#9733;</span>'
    return f"<b>{mark}{written}</b>" if place in row.best else written


def _settings(runs: Sequence[ComparedRun]) -> str:
    rows = [[f"<code>{text(key)}</code>", *map(text, values)] for key, values in differing_settings(runs)]
    if not rows:
        return "<p class=none>The settings are the same, or not known.</p>"
    return table(["setting", *_letters(runs)], rows, "settings")


def _distances(comparison: Comparison) -> str:
    lines = [(i, *found) for i, found in enumerate(comparison.distances_m, 1) if len(found[0])]
    if not lines:
        return "<p class=none>The paths share no times.</p>"
    if max(float(away.max()) for _, _, away in lines) < _SAME_M:
        return "<p class=none>The paths are the same.</p>"
    return distance_chart(lines)


def _cars(comparison: Comparison) -> str:
    """A table for each run beside the first, and what has no partner."""
    parts = []
    for i, (run, cars) in enumerate(zip(comparison.runs[1:], comparison.cars, strict=True), 1):
        pair = f'<span class="letter run0">A</span> &rarr; <span class="letter run{i}">{LETTERS[i]}</span>'
        parts.append(f"<h3>{pair} {text(run.name)}</h3>{_car_table(cars, LETTERS[i])}")
    return "".join(parts)


def _car_table(cars: ComparedCars, letter: str) -> str:
    headings = ["A", letter, "centre <small>cm, ahead / left / up</small>", "apart", "yaw"]
    headings += ["size <small>cm, l / w / h</small>", "mesh IoU"]
    rows = [
        [
            str(p.first_id),
            str(p.other_id),
            _signed(100 * p.centre_m),
            f"{number(100 * float(np.linalg.norm(p.centre_m)), 1)}<small> cm</small>",
            f"{_plus(p.yaw_deg, 1)}<small> &deg;</small>",
            _signed(100 * p.size_m),
            number(p.iou, 3),
        ]
        for p in cars.pairs
    ]
    left = [
        f"only in {name}: {', '.join(map(str, numbers))}"
        for name, numbers in (("A", cars.only_first), (letter, cars.only_other))
        if numbers
    ]
    unmatched = f"<p class=left>No partner: {'; '.join(left)}.</p>" if left else ""
    shown = table(headings, rows, "cars") if rows else "<p class=none>No car is in both maps.</p>"
    return shown + unmatched


def _signed(values: Floats) -> str:
    return " / ".join(_plus(float(v), 1) for v in values)


def _plus(value: float, decimals: int) -> str:
    """A number with its sign; none before zero."""
    rounded = round(value, decimals) + 0.0
    return ("+" if rounded > 0 else "") + number(rounded, decimals)


def _frames(comparison: Comparison) -> str:
    """A swipe for each frame, the first one shown; buttons choose the frame and which two runs."""
    if not comparison.frames:
        return "<p class=none>There is no frame that both runs can draw: see the notes.</p>"
    runs = comparison.runs
    choices = "".join(f"<option value={i}>{LETTERS[i]} {text(run.name)}</option>" for i, run in enumerate(runs))
    chosen = [choices.replace(f"<option value={i}>", f"<option value={i} selected>") for i in (0, 1)]
    buttons = "".join(
        f"<button type=button aria-pressed={'false' if k else 'true'} data-frame={k}>{frame.frame}</button>"
        for k, frame in enumerate(comparison.frames)
    )
    pictures = "".join(_swipe(k, frame, runs) for k, frame in enumerate(comparison.frames))
    return (
        f"<div class=bar><label>left <select id=left>{chosen[0]}</select></label>"
        f"<label>right <select id=right>{chosen[1]}</select></label><span class=switch id=choice>{buttons}</span></div>"
        f"<div id=swipes>{pictures}</div>"
        "<label class=slide><span>drag over the picture, or here</span>"
        "<input type=range id=share min=0 max=100 value=50 aria-label='share of the left run'></label>"
    )


def _swipe(place: int, frame: OverlayFrame, runs: Sequence[ComparedRun]) -> str:
    images = "".join(
        f'<img data-run={i} alt="frame {frame.frame}, {text(run.name)}" src="{jpeg_uri(picture)}">'
        for i, (run, picture) in enumerate(zip(runs, frame.pictures, strict=True))
    )
    hidden = " hidden" if place else ""
    names = "<b class=at-left>A</b><b class=at-right>B</b>"
    return f"<div class=swipe data-frame={place}{hidden}>{images}<i class=edge></i>{names}</div>"
