"""The page of a merged world: cars and drives from above, and what each drive says of each car."""

from __future__ import annotations

from string import Template

import numpy as np

from meshslam.geometry import Floats
from meshslam.maps import MapObject
from meshslam.merging import LaidDrive, Merged, MergedCar, Visit, World
from meshslam.viewing.comparison_plan import dashes_of
from meshslam.viewing.from_above import footprint
from meshslam.viewing.ground_plan import BAND_PX, PATH_POINTS, Plan, make_plan, px
from meshslam.viewing.markup import UNKNOWN, number, size_m, table, text

_PAGE = Template("""<!doctype html>
<html lang=en><meta charset=utf-8><meta name=viewport content="width=device-width">
<title>merged drives</title>
<style>
body { font: 15px/1.45 system-ui, sans-serif; max-width: 1180px; margin: 1.5rem auto; padding: 0 1rem; }
svg { width: 100%; border: 1px solid #8886; } svg text { font-size: 11px; text-anchor: middle; fill: currentColor; }
.path { fill: none; stroke: #777; stroke-width: 1.5; } .car { fill-opacity: .25; stroke-width: 1.5; }
.parked { fill: #2b6cb0; stroke: #2b6cb0; } .new { fill: #2f855a; stroke: #2f855a; }
.moved { fill: #b7791f; stroke: #b7791f; } .gone, .earlier { fill: none; stroke: #c53030; stroke-dasharray: 4 3; }
.earlier { stroke: #b7791f; } table { border-collapse: collapse; margin: .5rem 0 1.5rem; }
th, td { padding: .2rem .7rem; text-align: left; border-bottom: 1px solid #8884; } .scroll { overflow-x: auto; }
:root { color-scheme: light dark; }
</style>
<h1>Merged drives</h1>
<p>$summary</p>
$plan
<p>Blue: parked. Green: new since an earlier drive. Ochre: moved (dashed: where it stood). Red, dashed: gone.</p>
<h2>Drives</h2>
$drives
<h2>Cars and visits</h2>
$cars
<h2>Notes</h2>
<ul>$notes</ul>
</html>
""")


def merge_page(merged: Merged, world: World) -> str:
    """An HTML page of one world that opens offline."""
    summary = f"{len(world.drives)} drives, {len(world.standing)} cars that stand, {len(world.gone)} that have gone."
    return _PAGE.substitute(
        summary=summary,
        plan=_plan(merged, world),
        drives=_drives(merged, world),
        cars=_cars(merged, world),
        notes="".join(f"<li>{text(note)}</li>" for note in merged.notes),
    )


def _plan(merged: Merged, world: World) -> str:
    """An SVG of all paths, footprints and earlier places."""
    paths = [path.positions_in_world for path in merged.trajectories_in(world).values()]
    shown = [(car.status, car.thing) for car in world.cars]
    shown += [("earlier", thing) for car in world.cars for thing in car.earlier]
    hulls = [footprint(thing) for _, thing in shown]
    flat = np.concatenate([np.zeros((0, 2)), *hulls])
    everything = np.concatenate([np.column_stack([flat, np.zeros(len(flat))]), *paths])
    plan = make_plan(max(paths, key=len, default=everything), everything)
    lines = "".join(_path(plan, path, k) for k, path in enumerate(paths))
    cars = "".join(_car(plan, kind, thing, hull) for (kind, thing), hull in zip(shown, hulls, strict=True))
    size = f"{px(plan.width_px)} {px(plan.height_px + BAND_PX)}"
    return f'<svg role=img aria-label="drives and cars from above" viewBox="0 0 {size}">{lines}{cars}</svg>'


def _path(plan: Plan, path: Floats, place: int) -> str:
    if not len(path):
        return ""
    pixels = plan.pixels(path[:: len(path) // PATH_POINTS + 1])
    return f'<polyline class=path stroke-dasharray="{dashes_of(place)}" points="{_points(pixels)}"/>'


def _car(plan: Plan, kind: str, thing: MapObject, hull: Floats) -> str:
    centre = plan.pixels(thing.world_from_object.translation)
    name = "" if kind == "earlier" else str(thing.id)
    label = f'<text x="{px(centre[0])}" y="{px(centre[1] + 4)}">{name}</text>'
    return f'<polygon class="car {kind}" points="{_points(plan.pixels(hull))}"/>{label}'


def _points(pixels: Floats) -> str:
    return " ".join(f"{px(x)},{px(y)}" for x, y in pixels.tolist())


def _drives(merged: Merged, world: World) -> str:
    headings = ["drive", "laid by", "cars", "shared", "turned, deg", "moved, m", "sigma, m", "residual, m"]
    return table(headings, [_drive(merged, world, laid) for laid in world.drives], "drives")


def _drive(merged: Merged, world: World, laid: LaidDrive) -> list[str]:
    drive = merged.drives[laid.index]
    sigma = laid.sigmas_at(world.middle_of(merged, laid))[0]
    residual = float(np.median(laid.residuals_m)) if len(laid.residuals_m) else None
    shift = ", ".join(number(value, 2) for value in laid.world_from_drive.translation.tolist())
    turn = number(float(np.degrees(laid.world_from_drive.yaw_rad)), 2)
    figures = [str(len(drive.map)), str(laid.shared_cars), turn, shift, number(sigma, 3), number(residual, 3)]
    return [text(drive.name), laid.how, *figures]


def _cars(merged: Merged, world: World) -> str:
    names = [text(merged.drives[laid.index].name) for laid in world.drives]
    return table(
        ["car", "state", "length &times; width &times; height", "views", *names], [_row(c) for c in world.cars]
    )


def _row(car: MergedCar) -> list[str]:
    thing = car.thing
    return [str(thing.id), car.status, size_m(thing.dimensions), str(thing.views), *map(_visit, car.visits)]


def _visit(visit: Visit) -> str:
    """Where the car was, in a word, its number there, and how far from where the merged map has it."""
    said = visit.status.replace("_", " ")
    if visit.number is None:
        return said if visit.status != "unknown" else UNKNOWN
    return f"{said} as {visit.number}, {number(visit.apart_m, 2)} m"
