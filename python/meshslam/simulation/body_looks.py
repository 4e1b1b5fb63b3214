"""Draw what vans, trucks and buses look like."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from meshslam.categories import CarShape
from meshslam.geometry import Floats
from meshslam.simulation.cars import Kind
from meshslam.simulation.look import Bodywork, Look, draw_look

UPRIGHT_REAR_M = 0.8  # a roof that ends so near to the tail makes it a hatch, an estate or a van

_CAR_COWL = 0.66  # of a car's height: its front is painted by shares of that height
_WORK_PAINTS_BGR = (  # with the shares among vans: white, silver, yellow, blue, red, grey, black, green
    (0.52, (0.86, 0.87, 0.87)),
    (0.12, (0.60, 0.60, 0.59)),
    (0.06, (0.08, 0.55, 0.80)),
    (0.09, (0.40, 0.18, 0.07)),
    (0.06, (0.07, 0.06, 0.50)),
    (0.07, (0.25, 0.24, 0.23)),
    (0.05, (0.03, 0.03, 0.03)),
    (0.03, (0.15, 0.28, 0.08)),
)


def look_of(rng: np.random.Generator, shape: CarShape, kind: Kind) -> Look:
    """Draw looks for a vehicle."""
    look = draw_look(rng, upright=shape.roof_rear_from_tail < UPRIGHT_REAR_M)
    return look if kind == "car" else _with_bodywork(rng, shape, kind, look)


def _with_bodywork(rng: np.random.Generator, shape: CarShape, kind: Kind, look: Look) -> Look:
    h, cowl = shape.height, shape.wheelbase / 2 - shape.cowl_from_axle
    scale = shape.cowl_height / (_CAR_COWL * h)
    shares = np.array([share for share, _ in _WORK_PAINTS_BGR])
    paint = np.array(_WORK_PAINTS_BGR[int(rng.choice(len(shares), p=shares / shares.sum()))][1])
    paint = np.clip(paint * rng.uniform(0.75, 1.12) + rng.normal(0, 0.02, 3), 0.01, 0.95)
    return replace(
        look,
        paint=paint,
        roof=paint,
        trim=np.full(3, rng.uniform(0.02, 0.06)) if rng.random() < 0.75 else paint,
        bumper_below=float(rng.choice([0.0, 0.55, 0.68], p=[0.25, 0.4, 0.35])) / h,
        cladding_below=float(rng.choice([0.30, 0.42], p=[0.7, 0.3])) / h,
        head_at=(float(rng.uniform(0.70, 0.84)), shape.light_share + float(rng.normal(0, 0.012))),
        head_size=(float(rng.uniform(0.10, 0.20)), float(rng.uniform(0.07, 0.16))),
        grille_height=look.grille_height * scale,
        intake_size=(look.intake_size[0], look.intake_size[1] * scale),
        tail_reach=float(rng.uniform(0.03, 0.16)),
        front_plate_height=float(rng.uniform(0.38, 0.55)) / h,
        rear_plate_height=float(rng.uniform(0.45, 0.62) if rng.random() < 0.5 else rng.uniform(0.7, 1.0)) / h,
        b_pillar=cowl - shape.windshield_run * float(rng.uniform(0.4, 0.8)) - float(rng.uniform(0.75, 1.0)),
        light_through=look.light_through * (0.4 if kind == "bus" else 1.0),
        rails=False,
        roof_window=False,
        bodywork=_drawn(rng, shape, kind),
    )


def _drawn(rng: np.random.Generator, shape: CarShape, kind: Kind) -> Bodywork:
    h, length, bed = shape.height, shape.length, shape.roof_rear_from_tail > UPRIGHT_REAR_M
    windshield_top = _windshield_top(rng, shape, kind)
    glass_top = windshield_top - float(rng.uniform(0.04, 0.12))
    sill = min(shape.cowl_height + float(rng.uniform(-0.10, 0.06)), glass_top - 0.3)
    glazed = _glazed(rng, kind)
    right, left = (length if glazed in ("all", "right") else 1.2 * float(glazed == "half") for _ in range(2))
    left = 0.0 if glazed == "right" else left
    rear_glass = bool(rng.random() < (0.9 if glazed == "all" else 0.5))
    rear_glass = bed or (rear_glass and kind != "truck")
    rear_sill = shape.deck_height + 0.08 * bed if kind == "van" or bed else min(shape.cowl_height, 1.4)
    rear_top = max(h - shape.window_top - float(rng.uniform(0.02, 0.07)), rear_sill + 0.25)
    lamps = shape.trunk_share * h if kind == "van" or bed else float(rng.uniform(0.22, 0.5)) * h
    lamp_half = float(rng.uniform(0.09, 0.15 if bed else 0.30)) * min(h / 2.0, 1.2)
    slide = kind == "van"
    return Bodywork(
        windshield_top=windshield_top,
        sill=sill,
        glass_top=glass_top,
        dip=float(rng.choice([0.0, rng.uniform(0.05, 0.2)])),
        panes=(left, right),
        pane_length=float(rng.uniform(0.9, 1.5)),
        recesses=bool(rng.random() < 0.6),
        rubber=bool(rng.random() < 0.6),
        slides=(slide and bool(rng.random() < 0.4), slide and bool(rng.random() < 0.9)),
        slide_length=float(rng.uniform(0.9, 1.3)),
        rail=sill - float(rng.uniform(0.05, 0.3)),
        two_doors=bool(rng.random() < (0.65 if kind != "bus" else 0.1)) and not bed,
        rear_glass=rear_glass,
        rear_sill=rear_sill,
        rear_top=rear_top,
        hinges=bool(rng.random() < 0.6),
        strip=float(rng.choice([0.0, rng.uniform(0.5, 0.75)], p=[0.45, 0.55])),
        lamp_height=lamps,
        lamp_out=float(rng.uniform(0.86, 0.96)),
        lamp_size=(float(rng.uniform(0.05, 0.12)), lamp_half),
        lamp_bands=_LAMP_BANDS[int(rng.integers(len(_LAMP_BANDS)))],
        brake_lamp=float(rng.choice([0.0, h - 0.10, rear_top + 0.06])),
        adverts=_drawn_adverts(rng, shape, sill),
    )


def _windshield_top(rng: np.random.Generator, shape: CarShape, kind: Kind) -> float:
    """The height of the windshield's upper edge."""
    roof = shape.height - max(shape.windshield_top, shape.roof_front_drop) - 0.02
    if kind == "van":
        return shape.height - shape.windshield_top + 0.02
    return min(roof, shape.cowl_height + float(rng.uniform(0.75, 1.05) if kind == "truck" else rng.uniform(1.4, 2.0)))


_LAMP_BANDS = ((0.0, 0.3), (0.3, 0.55), (0.6, 0.8), (0.0, 0.0))


def _glazed(rng: np.random.Generator, kind: Kind) -> str:
    """Which panes there are behind the front doors."""
    shares = {"van": [0.42, 0.16, 0.07, 0.35], "truck": [1.0, 0, 0, 0], "bus": [0, 0, 0, 1.0]}[kind]
    return str(rng.choice(["none", "half", "right", "all"], p=shares))


def _drawn_adverts(rng: np.random.Generator, shape: CarShape, sill: float) -> Floats:
    count = int(rng.choice([0, 1, 2, 3], p=[0.5, 0.2, 0.2, 0.1]))
    rows = []
    for _ in range(count):
        at_rear = rng.random() < 0.3
        x = rng.uniform(shape.rear + 0.6, 0.2)
        half_x = rng.uniform(0.15, 0.5) if at_rear else rng.uniform(0.2, 1.0)
        z = rng.uniform(0.7, max(shape.height - 0.4, 1.0))
        rows.append([x, z, half_x, rng.uniform(0.06, 0.35), *rng.uniform(0.02, 0.9, 3), float(at_rear)])
    return np.array(rows).reshape(-1, 8)
