"""Colour and shine of a car's surface at a point, from the car's measures and its looks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.categories import CarShape
from meshslam.geometry import Bools, Floats
from meshslam.simulation.bodywork import painted_bodywork, painted_rear
from meshslam.simulation.look import Look
from meshslam.simulation.patches import SurfacePoints, rounded_box, surface_points


@dataclass(frozen=True, eq=False)
class Surface:
    """Points of a car's surface in the car's frame, and what they are made of."""

    colour: Floats  # (n, 3) BGR
    mirror: Floats  # (n,), share of the surroundings that is mirrored when looked at straight on
    glass: Bools  # (n,)


def surface(car: CarShape, look: Look, points: Floats, normals: Floats) -> Surface:
    """Paint points (n, 3) with normals (n, 3), both in the car's frame."""
    p = surface_points(car, points, normals)
    colour = np.tile(look.paint, (len(points), 1))
    mirror = np.full(len(points), 0.05 * look.gloss)
    colour[(p.share > 0.86) & (p.nz > 0.6)] = look.roof
    if look.bodywork is None:
        _seams(car, look, p, colour)
        matte = _plastic(car, look, p, colour)
        glass = _glass(car, look, p, colour)
    else:
        matte = _plastic(car, look, p, colour)
        glass = painted_bodywork(car, look, look.bodywork, p, colour)
    rear = _rear if look.bodywork is None else painted_rear
    for paint in (_front, rear, _plates, _mirrors):
        paint(car, look, p, colour, glass)
    wheel = _wheels(car, look, p, colour)
    mirror[matte | wheel] = 0.01
    mirror[glass] = 0.10 * look.glass_shine
    return Surface(colour, mirror, glass)


def _seams(car: CarShape, look: Look, p: SurfacePoints, colour: Floats) -> None:
    """Gaps of doors and lids, handles, the sill's crease."""
    belt = car.belt_height - car.belt_rise * p.x
    cowl = car.wheelbase / 2 - car.cowl_from_axle
    side = (p.ny > 0.5) & (p.z < belt) & (p.share > 0.17)
    rear_door = -car.wheelbase / 2 + 0.34
    for at in (cowl - 0.28, look.b_pillar, rear_door if look.panes else -9.0):
        colour[side & (np.abs(p.x - at - 0.08 * (belt - p.z)) < 0.013)] *= 0.35
    crease = side & (np.abs(p.z - car.widest - 0.03 * np.sin(look.phase[0]) * p.x) < 0.02)
    colour[crease] *= 0.8
    for at in (look.b_pillar + 0.16, rear_door + 0.16):
        colour[side & rounded_box(p.x - at, p.z - belt + 0.11, 0.10, 0.022)] *= 0.45
    hood = (p.nx > 0.05) & (p.share > 0.44) & (p.share < 0.7) & (p.x > cowl)
    colour[hood & (np.abs(p.out - 0.80 * p.half) < 0.014)] *= 0.45
    lid = (p.nx < -0.3) & (p.share > 0.3) & (p.share < 0.68)
    colour[lid & (np.abs(p.out - 0.66 * car.width / 2) < 0.012)] *= 0.45
    colour[lid & (np.abs(p.share - 0.42) < 0.008)] *= 0.45


def _plastic(car: CarShape, look: Look, p: SurfacePoints, colour: Floats) -> Bools:
    """Black lower edges, underbody, roof rails."""
    ends = (p.x > car.front - 0.45) | (p.x < car.rear + 0.45)
    low = (ends & (p.share < look.bumper_below)) | (p.share < look.cladding_below)
    under = (p.nz < -0.5) & (p.share < 0.3)
    colour[low] = 0.055
    colour[under] = 0.015
    if look.rails:
        rail = (p.share > 0.9) & (np.abs(p.out - 0.88 * p.half) < 0.035) & (p.ny > 0.1) & (np.abs(p.x + 0.4) < 1.1)
        colour[rail] = 0.05 if look.phase[1] < 3 else 0.5
    if look.roof_window:
        colour[(p.nz > 0.9) & (p.share > 0.85) & rounded_box(p.x + 0.1, p.y, 0.35, 0.38)] = 0.03
    merged: Bools = low | under
    return merged


def _glass(car: CarShape, look: Look, p: SurfacePoints, colour: Floats) -> Bools:
    """Windshield, side panes, rear window, what is behind them; returns where the glass is."""
    cowl = car.wheelbase / 2 - car.cowl_from_axle
    top = car.height - 0.085
    roof_front, roof_rear = cowl - car.windshield_run, car.rear + car.roof_rear_from_tail
    front_line = np.interp(p.z, [car.cowl_height, car.height - car.roof_front_drop], [cowl, roof_front])
    rear_line = np.interp(
        p.z, [car.deck_height, car.height - car.roof_rear_drop], [car.rear + car.deck_from_tail, roof_rear]
    )
    belt = car.belt_height - car.belt_rise * p.x
    upper = p.z < top - 0.02
    edge = 0.75 + 0.3 * look.a_pillar / 0.12
    windshield = (p.nx > 0.18) & (p.nx > edge * p.ny) & (p.z > car.cowl_height + 0.02) & upper & (p.x > -0.4)
    back = (p.nx < -0.12) & (-p.nx > edge * p.ny) & (p.z > car.deck_height + 0.04) & upper & (p.x < rear_line + 0.4)
    panes = (p.ny > 0.55) & (p.z > belt + 0.03) & (p.z < top - 0.03)
    panes &= (p.x < front_line - 0.10 - look.a_pillar) & (p.x > rear_line + look.c_pillar)
    greenhouse = (p.z > belt) & (p.z < top) & (p.nz < 0.85) & (p.x < cowl) & (p.ny > 0.3)
    colour[greenhouse & (p.x < front_line) & (np.abs(p.x - look.b_pillar) < 0.9)] = look.trim
    pillar = np.abs(p.x - look.b_pillar - 0.05 * (p.z - belt)) < 0.045
    divider = np.abs(p.x + car.wheelbase / 2 - 0.15) < 0.025
    panes &= ~pillar & ~divider
    if not look.panes:
        panes &= p.x > look.b_pillar
    colour[(np.abs(p.z - car.cowl_height) < 0.035) & (p.nx > 0.1) & (p.x > 0)] = 0.03  # wipers and their well
    glass: Bools = windshield | panes | back
    inside = np.tile(look.glass, (len(p.x), 1))
    inside *= (1.0 + 0.5 * np.sin(7 * p.x + 9 * p.z + look.phase[2]) * np.sin(6 * p.y + look.phase[3]))[:, None]
    inside[(p.x < look.b_pillar) & (panes | back)] *= look.privacy
    if look.light_through > 0:
        clear = (np.sin(3.1 * p.x + look.phase[4]) + np.sin(5 * p.z + 4 * p.y + look.phase[5]) > 0.2) & (panes | back)
        inside[clear] += look.light_through * look.privacy
    if look.headrests:
        rests = rounded_box(p.out - 0.36, p.z - belt - 0.12, 0.13, 0.12, 2) & (windshield | back)
        inside[rests] *= 0.5
    colour[glass] = np.clip(inside, 0.005, 0.9)[glass]
    if look.wiper:
        colour[back & (np.abs(p.z - car.deck_height - 0.09 - 0.08 * p.y) < 0.012) & (p.y < 0.1)] = 0.02
    if look.high_lamp:
        lamp = (p.nx < -0.1) & (np.abs(p.z - top + 0.02) < 0.025) & (p.out < 0.16) & (p.x < 0)
        colour[lamp] = look.tail_colour * 0.8
        glass &= ~lamp
    return glass


def _front(car: CarShape, look: Look, p: SurfacePoints, colour: Floats, glass: Bools) -> None:
    """Grille, intake, lamps."""
    h, w = car.height, car.width / 2
    face = (p.nx > 0.25) & (p.x > car.front - 0.8) & ~glass
    gap = p.share - look.grille_height
    half_y, half_z = look.grille_size[0], look.grille_size[1] / h * 0.9
    if look.grille_style != "none":
        grille = face & rounded_box(p.y, gap, half_y, half_z)
        if look.grille_style == "split":
            grille &= p.out > 0.05
        ring = face & rounded_box(p.y, gap, half_y + 0.03, half_z + 0.018) & ~grille
        colour[grille] = look.grille_colour
        stripes = np.sin(p.z * 130 if look.grille_style == "bars" else p.y * 110) > 0.3
        colour[grille & stripes] = 0.5 if look.chrome else look.grille_colour * 2.0
        if look.chrome:
            colour[ring] = 0.7
    intake = face & rounded_box(p.y, p.share - 0.19, look.intake_size[0], look.intake_size[1] / h)
    colour[intake] = 0.02
    if look.fog_holes:
        hole = face & rounded_box(p.out - 0.72 * w, p.share - 0.20, 0.13, 0.035)
        colour[hole] = 0.03
        colour[hole & rounded_box(p.out - 0.72 * w, p.share - 0.20, 0.045, 0.025, 2)] = 0.7
    if look.badge:
        colour[face & (np.hypot(p.y, p.z - look.grille_height * h - 0.02) < 0.05)] = 0.65
    _head_lamps(car, look, p, colour, glass)


def _head_lamps(car: CarShape, look: Look, p: SurfacePoints, colour: Floats, glass: Bools) -> None:
    h, w = car.height, car.width / 2
    along = p.out + 0.5 * np.maximum(car.front - 0.12 - p.x, 0) - look.head_at[0] * w
    up = p.z - look.head_at[1] * h - look.head_slant * 0.35 * along
    near = (p.x > car.front - 0.12 - look.head_reach) & ((p.nx > 0.1) | (p.ny > 0.3)) & ~glass & (p.nz < 0.9)
    if look.head_style == "round":
        lamp = near & (np.hypot(along, up) < 0.8 * look.head_size[0])
    else:
        lamp = near & rounded_box(along, up, look.head_size[0], look.head_size[1], 3)
    colour[near & rounded_box(along, up, look.head_size[0] + 0.015, look.head_size[1] + 0.015, 3)] *= 0.4
    base = look.head_colour * (0.35 if look.head_style == "smoked" else 1.0)
    pattern = 0.75 + 0.25 * np.sin(40 * along + look.phase[6]) * np.sin(50 * up + look.phase[7])
    colour[lamp] = base * pattern[lamp, None]
    colour[lamp & (np.hypot(along + 0.05, up) < 0.04)] = 0.12 if look.head_style == "bright" else 0.9
    if look.indicator:
        colour[lamp & (along > 0.5 * look.head_size[0])] = [0.12, 0.40, 0.80]


def _rear(car: CarShape, look: Look, p: SurfacePoints, colour: Floats, glass: Bools) -> None:
    """Lamps, reflectors, exhaust, diffuser."""
    h, w = car.height, car.width / 2
    near = (p.x < car.rear + 0.12 + look.tail_reach) & ((p.nx < -0.1) | (p.ny > 0.3)) & ~glass & (p.nz < 0.92)
    along = p.out + 0.5 * np.maximum(p.x - car.rear - 0.12, 0)
    wide, high = look.tail_size
    up = p.share - look.tail_height
    if look.tail_style == "upright":
        lamp = near & rounded_box(along - 0.86 * w, up - 0.05, 0.6 * wide, 1.5 * high / h * 1.3)
    elif look.tail_style == "round":
        lamp = near & (np.hypot(along - 0.74 * w, up * h) < high) | (
            near & (np.hypot(along - 0.74 * w + 2.2 * high, up * h) < 0.8 * high)
        )
    else:
        lamp = near & rounded_box(along - w + 0.9 * wide, up, wide, high / h)
        if look.tail_style == "bar":
            lamp |= near & (np.abs(up) * h < 0.35 * high) & (p.nx < -0.2)
    colour[near & _rim(along, up * h, w, wide, high)] *= 0.7
    shade = 0.8 + 0.3 * np.sin(60 * along + look.phase[6]) * np.sin(45 * p.z + look.phase[7])
    colour[lamp] = np.clip(look.tail_colour * shade[lamp, None], 0, 1)
    inner = up * h < -0.3 * high if look.phase[0] < 3 else along < 0.68 * w
    colour[lamp & inner] = look.tail_clear
    face = (p.nx < -0.3) & (p.x < car.rear + 0.6) & ~glass
    if look.reflectors:
        colour[face & rounded_box(p.out - 0.74 * w, p.share - 0.24, 0.09, 0.014)] = look.tail_colour
    colour[face & (p.share < 0.20) & (p.out < 0.6 * w)] = 0.05
    if look.exhaust:
        colour[face & (np.hypot(p.out - 0.5 * w, p.share * h - 0.19 * h) < 0.05)] = 0.35
    if look.badge:
        colour[face & (np.hypot(p.y, p.z - 0.60 * h) < 0.045)] = 0.6


def _rim(along: Floats, up: Floats, w: float, wide: float, high: float) -> Bools:
    return rounded_box(along - w + 0.9 * wide, up, wide + 0.015, high + 0.015)


def _plates(car: CarShape, look: Look, p: SurfacePoints, colour: Floats, glass: Bools) -> None:
    """Number plates with their characters, and the dark recess of the one at the rear."""
    half_y, half_z = look.plate_size
    text = (np.sin(p.y * 85 + look.phase[1]) + np.sin(p.y * 47 + look.phase[2]) > 0.35) & (p.out < 0.85 * half_y)
    for rear, height, shown in (
        (False, look.front_plate_height, look.front_plate),
        (True, look.rear_plate_height, True),
    ):
        gap = p.z - height * car.height
        face = (p.nx < -0.3 if rear else p.nx > 0.3) & ~glass
        if rear:
            recess = face & rounded_box(p.y, gap - 0.02, half_y + 0.12, half_z + 0.05)
            colour[recess] *= 0.55
        plate = face & rounded_box(p.y, gap, half_y, half_z, 8)
        if shown:
            colour[plate] = look.plate_colour
            colour[plate & text & (np.abs(gap) < 0.6 * half_z)] = 0.05


def _mirrors(car: CarShape, look: Look, p: SurfacePoints, colour: Floats, glass: Bools) -> None:
    """The mirrors: painted ahead, dark where the driver looks."""
    tip = car.mirror_tip
    cone = (p.out > p.half + 0.03) & (np.hypot(p.x - tip[0], p.z - tip[2]) < 0.3) & (p.share > 0.5)
    colour[cone] = look.trim
    colour[cone & (p.nx < -0.3)] = 0.15
    glass &= ~cone


def _wheels(car: CarShape, look: Look, p: SurfacePoints, colour: Floats) -> Bools:
    """Arches, tyres and rims; returns where they are."""
    hub = np.where(p.x > 0, car.wheelbase / 2, -car.wheelbase / 2)
    dx, dz = p.x - hub, p.z - car.tyre_radius
    away = np.hypot(dx, dz) / car.tyre_radius
    beside = p.out > car.width / 2 - car.wheel_inset - car.tyre_width - 0.05
    arch = beside & (away < 1.16) & ((p.ny > 0.2) | (p.z < car.clearance))
    colour[arch] = 0.015
    tyre = beside & (away < 1.0)
    colour[tyre] = 0.035
    rim = beside & (away < look.rim_radius) & (p.ny > 0.2)
    turn = np.arctan2(dz, dx)
    spokes = np.cos(look.spokes * turn + look.phase[0]) > look.spoke_share
    colour[rim] = 0.04
    solid = spokes | (away < 0.2) | (away > look.rim_radius * 0.9)
    colour[rim & solid] = look.rim_colour
    wheels: Bools = arch | tyre
    return wheels
