"""Paint sides and rear ends of vans, trucks and buses: panes or none, sliding doors, rear doors, upright lamps."""

from __future__ import annotations

import numpy as np

from meshslam.categories import CarShape
from meshslam.geometry import Bools, Floats
from meshslam.simulation.look import Bodywork, Look
from meshslam.simulation.patches import SurfacePoints, rounded_box

_FRAME_M = 0.022  # rubber about a pane
_GAP_M = 0.012  # half of a door's gap


def painted_bodywork(car: CarShape, look: Look, body: Bodywork, p: SurfacePoints, colour: Floats) -> Bools:
    """Paint everything but front, lamps, plates, mirrors and wheels; returns where the glass is."""
    _adverts(body, p, colour)
    _side_doors(car, look, body, p, colour)
    _rear_doors(car, body, p, colour)
    panes = _side_panes(car, look, body, p, colour)
    windshield, back = _end_panes(car, look, body, p)
    _recesses(car, look, body, p, colour)
    glass: Bools = windshield | panes | back
    colour[glass] = _behind_glass(look, p, panes | back)[glass]
    wipers = (np.abs(p.z - car.cowl_height) < 0.035) & (p.nx > 0.1) & (p.x > 0)
    colour[wipers] = 0.03
    return glass & ~wipers


def painted_rear(car: CarShape, look: Look, p: SurfacePoints, colour: Floats, glass: Bools) -> None:
    """Upright lamps at the corners, the third brake lamp, reflectors, the step."""
    body = look.bodywork
    if body is None:
        return
    w = car.width / 2
    near = (p.x < car.rear + 0.12 + look.tail_reach) & ((p.nx < -0.1) | (p.ny > 0.3)) & ~glass & (p.nz < 0.92)
    along = p.out + 0.5 * np.maximum(p.x - car.rear - 0.12, 0) - body.lamp_out * w
    up = p.z - body.lamp_height
    half_y, half_z = body.lamp_size
    colour[near & rounded_box(along, up, half_y + 0.015, half_z + 0.015, 6)] *= 0.6
    lamp = near & rounded_box(along, up, half_y, half_z, 6)
    shade = 0.8 + 0.3 * np.sin(60 * along + look.phase[6]) * np.sin(45 * p.z + look.phase[7])
    colour[lamp] = np.clip(look.tail_colour * shade[lamp, None], 0, 1)
    share = up / (2 * half_z) + 0.5
    colour[lamp & (share > body.lamp_bands[0]) & (share < body.lamp_bands[1])] = look.tail_clear
    face = (p.nx < -0.3) & (p.x < car.rear + 0.6) & ~glass
    if body.brake_lamp > 0:
        colour[face & rounded_box(p.y, p.z - body.brake_lamp, 0.16, 0.025)] = look.tail_colour * 0.8
    if look.reflectors:
        colour[face & rounded_box(p.out - 0.78 * w, p.z - 0.52, 0.08, 0.025)] = look.tail_colour
    if look.badge:
        colour[face & (np.hypot(p.y - 0.5 * w, p.z - 0.9) < 0.05)] = 0.6


def _windshield_lines(car: CarShape, z: Floats) -> Floats:
    """The x of the windshield at heights z (n,)."""
    cowl = car.wheelbase / 2 - car.cowl_from_axle
    heights = [car.cowl_height, car.height - car.roof_front_drop]
    return np.interp(z, heights, [cowl, cowl - car.windshield_run])


def _side_panes(car: CarShape, look: Look, body: Bodywork, p: SurfacePoints, colour: Floats) -> Bools:
    front_line = _windshield_lines(car, p.z)
    sill = body.sill - body.dip * np.clip((p.x - look.b_pillar) / 0.9, 0, 1)
    side = p.ny > 0.55
    glazed_to = look.b_pillar - np.where(p.y > 0, body.panes[0], body.panes[1])
    glazed_to = np.maximum(glazed_to, car.rear + look.c_pillar)
    from_pillar = look.b_pillar - 0.05 - p.x
    divider = (from_pillar > 0) & (np.mod(from_pillar, body.pane_length) < 0.09)
    ahead = front_line - 0.10 - look.a_pillar

    def panes(more: float) -> Bools:
        found = side & (p.z > sill - more) & (p.z < body.glass_top + more) & (p.x < ahead + more)
        found &= (p.x > glazed_to - more) & ~(np.abs(p.x - look.b_pillar) < 0.05 - more)
        inside: Bools = found & ~divider if more == 0 else found
        return inside

    clear = panes(0.0)
    if body.rubber:
        colour[panes(_FRAME_M) & ~clear] = 0.025
    return clear


def _end_panes(car: CarShape, look: Look, body: Bodywork, p: SurfacePoints) -> tuple[Bools, Bools]:
    """Windshield and rear windows."""
    edge = 0.75 + 0.3 * look.a_pillar / 0.12
    windshield = (p.nx > 0.18) & (p.nx > edge * p.ny) & (p.z > car.cowl_height + 0.02) & (p.z < body.windshield_top)
    if not body.rear_glass:
        return windshield, np.zeros_like(windshield)
    middle, half = (body.rear_sill + body.rear_top) / 2, (body.rear_top - body.rear_sill) / 2
    reach = (car.window_share + 0.06) * car.width / 2
    face = (p.nx < -0.12) & (-p.nx > edge * p.ny)
    if body.two_doors:
        across = (reach - 0.05) / 2
        back = face & rounded_box(p.out - 0.05 - across, p.z - middle, across, half, 10)
    else:
        back = face & rounded_box(p.y, p.z - middle, reach, half, 10)
    return windshield, back


def _behind_glass(look: Look, p: SurfacePoints, rearward: Bools) -> Floats:
    """Colours (n, 3) of glass: dark, with what is seen through it."""
    inside = np.tile(look.glass, (len(p.x), 1))
    inside *= (1.0 + 0.5 * np.sin(7 * p.x + 9 * p.z + look.phase[2]) * np.sin(6 * p.y + look.phase[3]))[:, None]
    inside[(p.x < look.b_pillar) & rearward] *= look.privacy
    if look.light_through > 0:
        clear = (np.sin(3.1 * p.x + look.phase[4]) + np.sin(5 * p.z + 4 * p.y + look.phase[5]) > 0.2) & rearward
        inside[clear] += look.light_through * look.privacy
    return np.clip(inside, 0.005, 0.9)


def _recesses(car: CarShape, look: Look, body: Bodywork, p: SurfacePoints, colour: Floats) -> None:
    """Pressed outlines where the sides and doors could have panes but have none."""
    if not body.recesses:
        return
    back = look.b_pillar - 0.15
    half_x, half_z = (back - car.rear - 0.25) / 2, (body.glass_top - body.sill) / 2
    dx = p.x - (back + car.rear + 0.25) / 2
    glazed = np.where(p.y > 0, body.panes[0], body.panes[1]) > 0
    side = (p.ny > 0.5) & ~glazed & (half_x > 0.2)
    dz = p.z - (body.glass_top + body.sill) / 2
    outline = rounded_box(dx, dz, max(half_x, 0.2), half_z, 12)
    outline &= ~rounded_box(dx, dz, max(half_x, 0.2) - 0.02, half_z - 0.02, 12)
    colour[side & outline] *= 0.75
    colour[side & outline & (dz > 0)] *= 0.8


def _side_doors(car: CarShape, look: Look, body: Bodywork, p: SurfacePoints, colour: Floats) -> None:
    """Gaps of front and sliding doors, handles, the rail, the rubbing strip."""
    side = (p.ny > 0.5) & (p.share > 0.13) & (p.z < body.glass_top + 0.12)
    front_door = look.b_pillar + 1.05
    for at in (front_door, look.b_pillar):
        colour[side & (np.abs(p.x - at) < _GAP_M) & (p.z < body.glass_top + 0.05)] *= 0.35
    slide = np.where(p.y > 0, body.slides[0], body.slides[1])
    end = look.b_pillar - 0.03 - body.slide_length
    colour[side & slide & (np.abs(p.x - end) < _GAP_M)] *= 0.35
    rail = side & slide & (np.abs(p.z - body.rail) < 0.025) & (p.x < end) & (p.x > max(car.rear + 0.15, end - 1.2))
    colour[rail] *= 0.3
    for at, there in ((look.b_pillar + 0.14, True), (look.b_pillar - 0.17, slide)):
        handle = side & there & rounded_box(p.x - at, p.z - body.sill + 0.14, 0.09, 0.03)
        colour[handle] = 0.05 if look.phase[0] < 4 else colour[handle] * 0.5
    if body.strip > 0:
        colour[(p.ny > 0.5) & (np.abs(p.z - body.strip) < 0.05)] = 0.06
    crease = side & (np.abs(p.z - body.sill + 0.3) < 0.015)
    colour[crease] *= 0.82


def _rear_doors(car: CarShape, body: Bodywork, p: SurfacePoints, colour: Floats) -> None:
    """Gaps of two doors or of a lid, hinges, the handle."""
    face = (p.nx < -0.3) & (p.x < car.rear + 0.6) & (p.z > 0.42)
    w = car.width / 2
    outer = np.abs(p.out - 0.84 * w) < _GAP_M
    colour[face & outer & (p.z < car.height - 0.15)] *= 0.45
    colour[face & (np.abs(p.z - car.height + 0.13) < _GAP_M) & (p.out < 0.84 * w)] *= 0.45
    colour[face & (np.abs(p.z - 0.55) < _GAP_M)] *= 0.45
    if body.two_doors:
        colour[face & (p.out < _GAP_M)] *= 0.3
    colour[face & rounded_box(p.y - 0.12, p.z - body.rear_sill + 0.12, 0.06, 0.035)] = 0.05
    if body.hinges:
        for height in (0.75, body.rear_sill - 0.05, car.height - 0.35):
            colour[face & rounded_box(p.out - 0.84 * w, p.z - height, 0.05, 0.035)] *= 0.4


def _adverts(body: Bodywork, p: SurfacePoints, colour: Floats) -> None:
    """Coloured patches and lines of text on the sides and on the rear doors."""
    for x, z, half_x, half_z, blue, green, red, at_rear in body.adverts:
        on = (p.nx < -0.4) if at_rear else (p.ny > 0.5)
        along = p.y if at_rear else p.x - x
        patch = on & rounded_box(along, p.z - z, half_x, half_z, 12)
        text = np.sin(along * 55 + x) + np.sin(along * 31 + z) + 0.8 * np.sin(p.z * 25 + x) > 0.3
        colour[patch & (text if blue + z > red + 1.2 else np.ones_like(text))] = [blue, green, red]
