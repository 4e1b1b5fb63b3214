"""Draw trucks and buses, COCO's classes, from the published dimensions of their body types.

Length, width (without mirrors), height, wheelbase and front overhang are those of manufacturers' data sheets. Trucks:
half-ton and mid-size pickups (F-150, Ranger), panel vans and 3.5 t bodies (Transit, Sprinter), cab-over distribution
trucks (Isuzu N, Atego), 18 t rigids (Actros), tippers. Buses: minibuses (Sprinter), low-floor city buses of 10 to 12 m
(Citaro, Lion's City), coaches (Tourismo, Setra 500), double-deckers (Enviro400), bonneted school buses (Vision). Width
ends at 2.55 m (96/53/EC). Tyres: 245/70 R17 to 315/80 R22.5, outer radius 0.36 to 0.54 m. A semitrailer turns against
its tractor and is no one shape: it is not in the family.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from meshslam.categories.procedural.car import CarShape

Measure = tuple[float, float]  # mean and standard deviation, metres


@dataclass(frozen=True)
class Body:
    """Size statistics of a body type, metres, and its share of the vehicles drawn."""

    share: float
    kind: Literal["panel", "box", "bed"]  # one roof; a box taller than the cab; a bed behind the cab
    length: Measure
    width: Measure
    height: Measure
    wheelbase: Measure
    front_overhang: Measure
    hood: Measure  # horizontal length from the front to the windshield's base
    cowl: Measure  # height of the windshield's base
    windshield: Measure  # its horizontal length
    cab: Measure  # length from the windshield's base to the cab's rear wall; of boxes and beds
    deck: Measure  # box: its height over the cab's roof; bed: height of its sides over the ground
    tyre: Measure  # radius
    clearance: Measure


NONE = (0.0, 0.0)
TRUCKS = (
    Body(0.16, "bed", (5.85, 0.20), (2.02, 0.04), (1.94, 0.04), (3.68, 0.15), (0.96, 0.05), (1.42, 0.08),
         (1.30, 0.04), (0.72, 0.06), (2.55, 0.20), (1.36, 0.05), (0.40, 0.015), (0.34, 0.03)),  # half-ton pickup
    Body(0.12, "bed", (5.34, 0.10), (1.88, 0.04), (1.82, 0.04), (3.18, 0.08), (0.90, 0.05), (1.30, 0.08),
         (1.18, 0.04), (0.75, 0.06), (2.45, 0.20), (1.26, 0.05), (0.38, 0.015), (0.32, 0.03)),  # mid-size pickup
    Body(0.18, "panel", (5.75, 0.45), (2.03, 0.04), (2.55, 0.15), (3.60, 0.30), (1.00, 0.05), (0.80, 0.10),
         (1.32, 0.05), (0.95, 0.08), NONE, NONE, (0.35, 0.015), (0.27, 0.03)),  # panel van
    Body(0.14, "box", (6.70, 0.40), (2.18, 0.06), (3.10, 0.12), (3.90, 0.30), (1.00, 0.04), (0.80, 0.10),
         (1.32, 0.05), (0.90, 0.08), (1.90, 0.10), (0.65, 0.12), (0.36, 0.015), (0.36, 0.04)),  # 3.5 t with a box
    Body(0.08, "bed", (6.30, 0.35), (2.10, 0.06), (2.32, 0.10), (3.75, 0.25), (1.00, 0.04), (0.80, 0.10),
         (1.32, 0.05), (0.90, 0.08), (1.95, 0.20), (1.32, 0.08), (0.36, 0.015), (0.36, 0.04)),  # 3.5 t, dropside
    Body(0.16, "box", (7.40, 0.80), (2.38, 0.10), (3.30, 0.18), (4.10, 0.45), (1.22, 0.08), (0.12, 0.04),
         (1.45, 0.10), (0.35, 0.06), (1.65, 0.12), (0.75, 0.15), (0.43, 0.03), (0.45, 0.05)),  # 7.5 to 12 t, box
    Body(0.10, "box", (9.60, 0.60), (2.53, 0.03), (3.80, 0.12), (5.50, 0.40), (1.42, 0.06), (0.12, 0.04),
         (1.75, 0.10), (0.30, 0.05), (2.10, 0.20), (0.50, 0.20), (0.51, 0.02), (0.52, 0.05)),  # 18 t, box
    Body(0.06, "bed", (7.20, 0.50), (2.50, 0.04), (3.00, 0.12), (4.00, 0.30), (1.40, 0.05), (0.12, 0.04),
         (1.70, 0.10), (0.30, 0.05), (1.75, 0.12), (2.30, 0.25), (0.52, 0.02), (0.52, 0.05)),  # tipper
)  # fmt: skip
BUSES = (
    Body(0.14, "panel", (7.00, 0.40), (2.02, 0.04), (2.78, 0.10), (4.10, 0.30), (1.02, 0.04), (0.80, 0.10),
         (1.32, 0.05), (0.95, 0.08), NONE, NONE, (0.36, 0.015), (0.28, 0.03)),  # minibus
    Body(0.40, "panel", (12.10, 0.20), (2.55, 0.01), (3.10, 0.06), (5.95, 0.12), (2.72, 0.05), (0.14, 0.04),
         (1.05, 0.08), (0.28, 0.08), NONE, NONE, (0.48, 0.01), (0.33, 0.03)),  # city bus of 12 m
    Body(0.10, "panel", (10.30, 0.40), (2.50, 0.05), (3.05, 0.08), (4.60, 0.30), (2.60, 0.10), (0.14, 0.04),
         (1.05, 0.08), (0.28, 0.08), NONE, NONE, (0.47, 0.01), (0.33, 0.03)),  # midibus
    Body(0.18, "panel", (12.50, 0.50), (2.55, 0.01), (3.66, 0.10), (6.10, 0.25), (2.80, 0.08), (0.16, 0.05),
         (1.35, 0.10), (0.50, 0.12), NONE, NONE, (0.51, 0.01), (0.36, 0.03)),  # coach
    Body(0.10, "panel", (11.00, 0.30), (2.54, 0.02), (4.32, 0.06), (5.70, 0.30), (2.60, 0.08), (0.16, 0.05),
         (1.10, 0.08), (0.40, 0.12), NONE, NONE, (0.48, 0.01), (0.33, 0.03)),  # double-decker
    Body(0.08, "panel", (10.60, 0.70), (2.44, 0.02), (3.12, 0.08), (6.30, 0.50), (1.05, 0.06), (1.35, 0.12),
         (1.62, 0.06), (0.40, 0.06), NONE, NONE, (0.49, 0.01), (0.45, 0.04)),  # school bus with a bonnet
)  # fmt: skip


def draw_truck(rng: np.random.Generator) -> CarShape:
    """Draw one truck from the body types by their shares."""
    return _draw(TRUCKS, rng)


def draw_bus(rng: np.random.Generator) -> CarShape:
    """Draw one bus from the body types by their shares."""
    return _draw(BUSES, rng)


def _draw(bodies: tuple[Body, ...], rng: np.random.Generator) -> CarShape:
    shares = np.array([body.share for body in bodies])
    return draw_body(bodies[int(rng.choice(len(bodies), p=shares / shares.sum()))], rng)


def draw_body(body: Body, rng: np.random.Generator) -> CarShape:
    """Draw one vehicle of a body type."""

    def near(mean: float, sigma: float) -> float:
        return float(mean + sigma * np.clip(rng.normal(), -2.5, 2.5))

    length, width, height = near(*body.length), min(near(*body.width), 2.55), near(*body.height)
    wheelbase, front_overhang, clearance = near(*body.wheelbase), near(*body.front_overhang), near(*body.clearance)
    rear_overhang = max(length - wheelbase - front_overhang, 0.75)
    length = wheelbase + front_overhang + rear_overhang
    hood, cowl_height, run = near(*body.hood), near(*body.cowl), near(*body.windshield)
    cab, deck, tyre = near(*body.cab), near(*body.deck), near(*body.tyre)
    behind_cab = length - hood - cab  # from the cab's rear wall to the tail
    roof = length - hood - run
    bed = body.kind == "bed"
    hood_front = cowl_height - near(0.16, 0.03) * min(1.0, 0.3 + hood)
    return CarShape(
        length=length,
        width=width,
        height=height,
        wheelbase=wheelbase,
        front_overhang=front_overhang,
        tyre_radius=tyre,
        tyre_width=near(0.30, 0.02),
        wheel_inset=near(0.04, 0.015),
        clearance=clearance,
        chin=clearance + near(0.06, 0.02),
        chin_setback=near(0.04, 0.02),
        chin_length=float(np.clip(near(0.30, 0.06), 0.1, front_overhang - tyre - 0.04)),
        nose_height=0.62 * cowl_height * near(1.0, 0.05),
        hood_front=hood_front,
        hood_setback=min(near(0.08, 0.03), 0.5 * hood),
        hood_crown=near(0.03, 0.015) * min(1.0, hood),
        cowl_from_axle=hood - front_overhang,
        cowl_height=cowl_height,
        windshield_run=run,
        roof_front_drop=deck if body.kind == "box" else near(0.09, 0.02),
        roof_peak=float(np.clip((cab - run + 0.2) / roof, 0.1, 0.5)) if body.kind == "box" else near(0.35, 0.05),
        roof_rear_from_tail=behind_cab + near(0.10, 0.04) if bed else near(0.12, 0.03),
        roof_rear_drop=near(0.05, 0.015),
        deck_from_tail=behind_cab - 0.08 if bed else near(0.06, 0.01),
        deck_height=deck if bed else height * near(0.62, 0.03),
        tail_height=deck - near(0.02, 0.01) if bed else height * near(0.45, 0.03),
        tail_setback=near(0.03, 0.01),
        tail_bulge=clearance + 0.35 * (deck - clearance if bed else 0.6 * height),
        rear_lip=clearance + near(0.08, 0.03),
        rear_lip_setback=near(0.04, 0.02),
        departure=float(np.clip(near(0.45, 0.10), 0.1, rear_overhang - tyre - 0.04)),
        widest=height * near(0.36, 0.03),
        rocker_inset=near(0.03, 0.01),
        belt_height=cowl_height + near(0.05, 0.03),
        belt_rise=near(0.0, 0.005),
        belt_inset=near(0.01, 0.005),
        shoulder=near(0.01, 0.005),
        tumblehome=near(0.22, 0.04) if bed and height < 2.1 else near(0.04, 0.02),
        taper_front=near(0.06, 0.02),
        taper_rear=near(0.02, 0.01),
        taper_lean=near(0.3, 0.2),
        glass_taper=near(0.01, 0.005),
        bow_front=near(0.15, 0.05),
        bow_rear=near(0.05, 0.02),
        bow_glass=near(0.12, 0.04),
        crown=near(0.04, 0.01),
        rounding=near(0.12, 0.03),
        rounding_low=near(0.08, 0.02),
        mirror_reach=near(0.09, 0.02),
        mirror_size=near(0.17, 0.02),
        tension=0.15,  # boxy; more lets the roof overshoot behind a tall windshield
        windshield_share=0.75,
        window_share=0.75,
        light_share=0.5 * cowl_height / height,
        trunk_share=(deck - 0.15) / height if bed else 0.60,
    )
