"""What tells one car's looks from another's: paint, lamps, plates, grille, glass, wheels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats

_PAINTS_BGR = (  # with the shares of cars on the road: white, black, greys, silver, blues, reds, others
    (0.16, (0.85, 0.86, 0.87)),
    (0.20, (0.03, 0.03, 0.03)),
    (0.12, (0.22, 0.21, 0.20)),
    (0.10, (0.40, 0.39, 0.38)),
    (0.16, (0.62, 0.62, 0.61)),
    (0.10, (0.35, 0.16, 0.07)),
    (0.07, (0.07, 0.06, 0.45)),
    (0.03, (0.14, 0.25, 0.08)),
    (0.03, (0.10, 0.55, 0.75)),
    (0.03, (0.10, 0.15, 0.25)),
)


@dataclass(frozen=True, eq=False)
class Bodywork:
    """Sides and rear end of one van, truck or bus. Lengths and heights over the ground in metres."""

    windshield_top: float
    sill: float  # lower edge of the side windows
    glass_top: float
    dip: float  # how far the front doors' windows reach down at their front end
    panes: tuple[float, float]  # length that is glazed behind the front doors, at the left and at the right
    pane_length: float
    recesses: bool  # pressed where panes would be
    rubber: bool  # dark frames around the panes
    slides: tuple[bool, bool]  # sliding doors at the left and at the right
    slide_length: float
    rail: float  # height of their rail
    two_doors: bool  # at the rear; else a lid
    rear_glass: bool
    rear_sill: float
    rear_top: float
    hinges: bool
    strip: float  # height of a rubbing strip; 0: none
    lamp_height: float
    lamp_out: float  # share of half the width
    lamp_size: tuple[float, float]  # half width, half height
    lamp_bands: tuple[float, float]  # shares of the lamp that are clear, from below and up to
    brake_lamp: float  # height of the third one; 0: none
    adverts: Floats  # (k, 8): middle x and z, half sizes, BGR, 1 on the rear doors or 0 on the sides


@dataclass(frozen=True, eq=False)
class Look:
    """Looks of one car. Lengths in metres, colours BGR from 0 to 1, heights as shares of the car's where said."""

    paint: Floats
    roof: Floats
    trim: Floats  # pillars, mirrors, mouldings
    bumper_below: float  # share of the height below which the bumpers are black plastic
    cladding_below: float  # likewise for the sides
    gloss: float
    # lamps at the front
    head_style: str  # "bright", "smoked", "round"
    head_at: tuple[float, float]  # lateral place as a share of half the width, height as a share
    head_size: tuple[float, float]
    head_slant: float
    head_reach: float  # how far it wraps around the corner
    head_colour: Floats
    indicator: bool
    grille_style: str  # "bars", "mesh", "split", "none"
    grille_size: tuple[float, float]
    grille_height: float
    grille_colour: Floats
    chrome: bool
    intake_size: tuple[float, float]
    fog_holes: bool
    badge: bool
    # lamps at the rear
    tail_style: str  # "corner", "upright", "bar", "round"
    tail_size: tuple[float, float]
    tail_height: float
    tail_reach: float
    tail_colour: Floats
    tail_clear: Floats  # colour of the reversing lamps and indicators in it
    high_lamp: bool
    reflectors: bool
    exhaust: bool
    wiper: bool
    # plates
    plate_colour: Floats
    plate_size: tuple[float, float]
    front_plate: bool
    rear_plate_height: float
    front_plate_height: float
    # glass
    glass: Floats
    glass_shine: float
    privacy: float  # how much darker the glass behind the front doors is
    panes: bool  # side panes behind the front doors
    a_pillar: float
    c_pillar: float
    b_pillar: float  # its x
    headrests: bool
    light_through: float
    # wheels
    spokes: int
    spoke_share: float
    rim_colour: Floats
    rim_radius: float  # share of the tyre's
    rails: bool
    roof_window: bool
    phase: Floats  # (8,) seeds of small patterns
    bodywork: Bodywork | None = None  # sides and rear of vans, trucks and buses


def draw_look(rng: np.random.Generator, upright: bool) -> Look:
    """Draw looks; `upright` rear ends (hatches, estates, vans) mostly carry upright lamps."""
    shares = np.array([share for share, _ in _PAINTS_BGR])
    paint = np.array(_PAINTS_BGR[int(rng.choice(len(shares), p=shares / shares.sum()))][1])
    paint = np.clip(paint * rng.uniform(0.7, 1.2) + rng.normal(0, 0.02, 3), 0.01, 0.95)
    dark = np.full(3, rng.uniform(0.015, 0.06))
    tails = ["upright", "corner", "bar", "round"]
    tail_style = str(rng.choice(tails, p=[0.55, 0.30, 0.10, 0.05] if upright else [0.08, 0.67, 0.15, 0.10]))
    red = np.array([rng.uniform(0.02, 0.15), rng.uniform(0.02, 0.12), rng.uniform(0.2, 0.8)])
    clear = np.array([[0.75, 0.78, 0.8], [0.15, 0.4, 0.8], red * 0.5, [0.5, 0.5, 0.7]])[rng.integers(4)]
    plate = np.array([[0.85, 0.86, 0.86], [0.80, 0.82, 0.83], [0.2, 0.7, 0.85], [0.6, 0.35, 0.15]])
    return Look(
        paint=paint,
        roof=dark if rng.random() < 0.08 else paint,
        trim=dark if rng.random() < 0.6 else paint,
        bumper_below=float(rng.choice([0.0, 0.18, 0.24, 0.36], p=[0.25, 0.35, 0.25, 0.15])),
        cladding_below=float(rng.choice([0.12, 0.17, 0.24], p=[0.5, 0.3, 0.2])),
        gloss=float(rng.uniform(0.3, 1.3)),
        head_style=str(rng.choice(["bright", "smoked", "round"], p=[0.72, 0.18, 0.10])),
        head_at=(float(rng.uniform(0.66, 0.80)), float(rng.uniform(0.415, 0.48))),
        head_size=(float(rng.uniform(0.14, 0.25)), float(rng.uniform(0.045, 0.105))),
        head_slant=float(rng.uniform(-0.1, 0.45)),
        head_reach=float(rng.uniform(0.15, 0.6)),
        head_colour=np.clip(rng.uniform(0.55, 1.0) + rng.normal(0, 0.04, 3), 0, 1),
        indicator=bool(rng.random() < 0.3),
        grille_style=str(rng.choice(["bars", "mesh", "split", "none"], p=[0.45, 0.3, 0.12, 0.13])),
        grille_size=(float(rng.uniform(0.22, 0.62)), float(rng.uniform(0.035, 0.11))),
        grille_height=float(rng.uniform(0.36, 0.45)),
        grille_colour=np.full(3, rng.uniform(0.01, 0.08)),
        chrome=bool(rng.random() < 0.45),
        intake_size=(float(rng.uniform(0.3, 0.75)), float(rng.uniform(0.03, 0.09))),
        fog_holes=bool(rng.random() < 0.5),
        badge=bool(rng.random() < 0.8),
        tail_style=tail_style,
        tail_size=(float(rng.uniform(0.12, 0.28)), float(rng.uniform(0.05, 0.12))),
        tail_height=float(rng.uniform(0.53, 0.64)),
        tail_reach=float(rng.uniform(0.08, 0.40)),
        tail_colour=red,
        tail_clear=clear,
        high_lamp=bool(rng.random() < 0.7),
        reflectors=bool(rng.random() < 0.5),
        exhaust=bool(rng.random() < 0.4),
        wiper=bool(upright and rng.random() < 0.7),
        plate_colour=plate[int(rng.choice(4, p=[0.55, 0.25, 0.15, 0.05]))] * rng.uniform(0.75, 1.1),
        plate_size=(0.26, 0.056) if rng.random() < 0.8 else (0.16, 0.08),
        front_plate=bool(rng.random() < 0.85),
        rear_plate_height=float(rng.uniform(0.30, 0.40) if rng.random() < 0.3 else rng.uniform(0.46, 0.58)),
        front_plate_height=float(rng.uniform(0.24, 0.35)),
        glass=np.clip(rng.uniform(0.015, 0.14) + rng.normal(0, 0.01, 3), 0.005, 1),
        glass_shine=float(rng.uniform(0.3, 1.6)),
        privacy=float(rng.choice([1.0, 0.35], p=[0.7, 0.3])),
        panes=bool(rng.random() < 0.9),
        a_pillar=float(rng.uniform(0.03, 0.12)),
        c_pillar=float(rng.uniform(0.06, 0.40)),
        b_pillar=float(rng.uniform(-0.25, 0.10)),
        headrests=bool(rng.random() < 0.7),
        light_through=float(rng.choice([0.0, rng.uniform(0.05, 0.5)])),
        spokes=int(rng.integers(5, 13)),
        spoke_share=float(rng.uniform(-0.5, 0.6)),
        rim_colour=np.full(3, float(rng.choice([0.65, 0.45, 0.25, 0.06], p=[0.45, 0.25, 0.15, 0.15]))),
        rim_radius=float(rng.uniform(0.60, 0.76)),
        rails=bool(upright and rng.random() < 0.4),
        roof_window=bool(rng.random() < 0.15),
        phase=rng.uniform(0, 6.28, 8),
    )
