"""Several runs from above, and how far their paths are apart; each run has a colour and a kind of line."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.maps import Map, MapObject
from meshslam.viewing.from_above import footprint, round_length_m
from meshslam.viewing.ground_plan import BAND_PX, PATH_POINTS, SCALE_BAR_PX, Plan, make_plan, px
from meshslam.viewing.markup import text

DASHES = ("", "7 4", "2 4", "10 3 2 3", "1 3", "14 5")  # kinds of line, one a run
CHART_WIDTH_PX, CHART_HEIGHT_PX, LEFT_PX, RIGHT_PX, TOP_PX, BOTTOM_PX = 1160.0, 240.0, 56.0, 16.0, 12.0, 34.0
LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"


def dashes_of(place: int) -> str:
    """A run's kind of line, as SVG's stroke-dasharray."""
    return DASHES[place % len(DASHES)] or "none"


def line_of(place: int) -> str:
    """A short piece of a run's line, for legends."""
    stroke = f'stroke-dasharray="{dashes_of(place)}"'
    path = f'<path class="stroke run{place}" {stroke} d="M1,5h34"/>'
    return f'<svg class=line viewBox="0 0 36 10" aria-hidden=true>{path}</svg>'


def comparison_plan(runs: Sequence[tuple[Sequence[Pose], Map]]) -> str:
    """An SVG of all paths and footprints; those of one run are a group: `run0` and so on."""
    paths = [np.array([pose.translation for pose in poses]).reshape(-1, 3) for poses, _ in runs]
    hulls = [[(thing, footprint(thing)) for thing in scene.objects] for _, scene in runs]
    flat = np.concatenate([np.zeros((0, 2)), *(hull for row in hulls for _, hull in row)])
    corners = np.column_stack([flat, np.zeros(len(flat))])
    first = max(paths, key=len)
    plan = make_plan(first, np.concatenate([corners, *paths]))
    groups = "".join(_run(plan, i, path, row) for i, (path, row) in enumerate(zip(paths, hulls, strict=True)))
    size = f"{px(plan.width_px)} {px(plan.height_px + BAND_PX)}"
    return (
        f'<svg class=plan role=img aria-label="paths and cars of all runs from above" viewBox="0 0 {size}">'
        f"{groups}{_scale(plan)}</svg>"
    )


def _run(plan: Plan, place: int, path: Floats, hulls: Sequence[tuple[MapObject, Floats]]) -> str:
    stroke = f'stroke-dasharray="{dashes_of(place)}"'
    cars = "".join(_car(plan, place, thing, hull, stroke) for thing, hull in hulls)
    if not len(path):
        return f'<g class="run{place}">{cars}</g>'
    pixels = plan.pixels(path[:: len(path) // PATH_POINTS + 1])
    start = f'<circle class="fill run{place}" cx="{px(pixels[0][0])}" cy="{px(pixels[0][1])}" r="{4 + place}"/>'
    return (
        f'<g class="run{place}"><polyline class="path stroke run{place}" {stroke} points="{_joined(pixels)}"/>'
        f"{start}{cars}</g>"
    )


def _car(plan: Plan, place: int, thing: MapObject, hull: Floats, stroke: str) -> str:
    nose = thing.world_from_object.transform(np.array([[0.3, 0.0, 0.0], [0.5, 0.0, 0.0]]) * thing.dimensions[0])
    corners, tick = plan.pixels(hull), plan.pixels(nose)
    centre = plan.pixels(thing.world_from_object.translation)
    below = float(corners[:, 1].max()) + 13 * place if place else float(corners[:, 1].min()) - 4
    title = f"<title>{LETTERS[place]}: {text(thing.category)} {thing.id}</title>"
    return (
        f'<g>{title}<polygon class="stroke run{place}" {stroke} points="{_joined(corners)}"/>'
        f'<polyline class="stroke run{place}" points="{_joined(tick)}"/>'
        f'<text class="fill run{place}" x="{px(centre[0])}" y="{px(below)}">{LETTERS[place]}{thing.id}</text></g>'
    )


def _scale(plan: Plan) -> str:
    length_m = round_length_m(SCALE_BAR_PX / plan.scale_px_per_m)
    length, y = length_m * plan.scale_px_per_m, plan.height_px + BAND_PX - 14
    line = f"M16,{px(y - 5)}v5h{length:.2f}v-5"
    return f'<g class=scale><path d="{line}"/><text x="{px(22 + length)}" y="{px(y)}">{length_m:g} m</text></g>'


def distance_chart(lines: Sequence[tuple[int, Floats, Floats]]) -> str:
    """An SVG of distances (m) over time (s), one line a run by its place."""
    longest = max(float(times[-1]) for _, times, _ in lines) or 1.0
    highest = max(float(away.max()) for _, _, away in lines) or 1e-3
    step = round_length_m(max(highest / 2.5, 1e-6))
    width, height = CHART_WIDTH_PX - LEFT_PX - RIGHT_PX, CHART_HEIGHT_PX - TOP_PX - BOTTOM_PX
    top = step * np.ceil(highest / step)

    def pixels(times: Floats, away: Floats) -> Floats:
        return np.column_stack([LEFT_PX + width * times / longest, TOP_PX + height * (1 - away / top)])

    grid = ""
    for value in np.arange(0, top + step / 2, step):
        y = px(float(pixels(np.zeros(1), np.array([value]))[0, 1]))
        grid += f'<path class=grid d="M{px(LEFT_PX)},{y}h{px(width)}"/>'
        grid += f'<text x="{px(LEFT_PX - 8)}" y="{y}" class=across>{_metres(float(value), step)}</text>'
    seconds = round_length_m(max(longest / 4, 1e-6))
    for value in np.arange(0, longest + 1e-9, seconds):
        x = px(LEFT_PX + width * float(value) / longest)
        grid += f'<text x="{x}" y="{px(CHART_HEIGHT_PX - 12)}" class=below>{value:g} s</text>'
    drawn = "".join(
        f'<polyline class="path stroke run{i}" stroke-dasharray="{dashes_of(i)}" points="{_joined(pixels(t, a))}"/>'
        for i, t, a in lines
    )
    size = f"{px(CHART_WIDTH_PX)} {px(CHART_HEIGHT_PX)}"
    return (
        f'<svg class=chart role=img aria-label="distance between the paths over time" viewBox="0 0 {size}">'
        f"{grid}{drawn}</svg>"
    )


def _metres(value: float, step: float) -> str:
    unit, factor = ("m", 1.0) if step >= 0.1 else ("cm", 100.0) if step >= 1e-3 else ("mm", 1000.0)
    return f"{value * factor:.3g} {unit}"


def _joined(pixels: Floats) -> str:
    return " ".join(f"{px(x)},{px(y)}" for x, y in pixels.tolist())
