"""Draw cars from the published size statistics of the classes of real cars.

Length, width (without mirrors), height and wheelbase per class are the general figures of manufacturers' data sheets
as the European segments A to F, J (SUV), M (MPV), pickups, vans and sports cars collect them; shares are roughly those
of registrations. Tyres are those of the common rims (155/65 R14 to 275/45 R21: outer radius 0.28 to 0.39 m). Ground
clearance is published at the lowest fixed part, 0.12-0.18 m for saloons and 0.18-0.25 m for SUVs; the mean underbody,
which is meant here, lies 5 to 7 cm above it. Bumpers stand out most at the height that rules fix for them (0.41 to
0.51 m, 49 CFR 581). Mirrors add 0.10 to 0.25 m to a data sheet's width; one vertex shows less of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.categories.procedural.car import CarShape


@dataclass(frozen=True)
class CarClass:
    """Size statistics of a class: (mean, standard deviation) in metres, and its share of the cars drawn."""

    style: str  # rear end: saloon, hatch, box, pickup, fastback
    share: float
    length: tuple[float, float]
    width: tuple[float, float]
    height: tuple[float, float]
    wheelbase: tuple[float, float]
    clearance: tuple[float, float]
    hood: tuple[float, float]  # hood's leading edge over the ground, as a share of the height


CLASSES = (
    CarClass("hatch", 0.05, (3.62, 0.13), (1.64, 0.05), (1.51, 0.05), (2.41, 0.08), (0.21, 0.025), (0.50, 0.03)),  # A
    CarClass("hatch", 0.08, (4.03, 0.12), (1.74, 0.04), (1.47, 0.04), (2.55, 0.05), (0.21, 0.025), (0.49, 0.03)),  # B
    CarClass("hatch", 0.09, (4.33, 0.10), (1.80, 0.03), (1.46, 0.03), (2.65, 0.05), (0.21, 0.025), (0.49, 0.03)),  # C
    CarClass("saloon", 0.11, (4.62, 0.14), (1.80, 0.04), (1.47, 0.03), (2.68, 0.06), (0.21, 0.025), (0.49, 0.03)),  # C
    CarClass("saloon", 0.11, (4.84, 0.12), (1.85, 0.04), (1.46, 0.03), (2.80, 0.06), (0.21, 0.025), (0.49, 0.03)),  # D
    CarClass(
        "saloon", 0.06, (5.02, 0.13), (1.89, 0.04), (1.48, 0.03), (2.96, 0.08), (0.21, 0.025), (0.49, 0.03)
    ),  # E-F
    CarClass("fastback", 0.05, (4.85, 0.18), (1.88, 0.05), (1.43, 0.04), (2.86, 0.10), (0.20, 0.025), (0.48, 0.03)),
    CarClass(
        "box", 0.07, (4.68, 0.20), (1.82, 0.04), (1.49, 0.04), (2.73, 0.10), (0.21, 0.025), (0.49, 0.03)
    ),  # estate
    CarClass(
        "hatch", 0.10, (4.22, 0.14), (1.79, 0.04), (1.60, 0.05), (2.58, 0.06), (0.26, 0.03), (0.52, 0.03)
    ),  # B SUV
    CarClass("box", 0.12, (4.53, 0.13), (1.86, 0.04), (1.68, 0.05), (2.68, 0.06), (0.28, 0.04), (0.53, 0.03)),  # C SUV
    CarClass(
        "box", 0.10, (4.87, 0.17), (1.94, 0.05), (1.77, 0.07), (2.88, 0.10), (0.31, 0.045), (0.54, 0.03)
    ),  # D-E SUV
    CarClass("hatch", 0.04, (4.78, 0.17), (1.95, 0.05), (1.63, 0.05), (2.85, 0.09), (0.28, 0.04), (0.53, 0.03)),
    CarClass("box", 0.05, (4.50, 0.25), (1.82, 0.05), (1.66, 0.07), (2.77, 0.12), (0.22, 0.025), (0.48, 0.03)),  # MPV
    CarClass("van", 0.03, (4.75, 0.35), (1.90, 0.08), (1.88, 0.07), (2.92, 0.20), (0.22, 0.03), (0.48, 0.03)),
    CarClass("pickup", 0.02, (5.30, 0.15), (1.88, 0.06), (1.80, 0.06), (3.15, 0.12), (0.32, 0.04), (0.55, 0.03)),
    CarClass("fastback", 0.03, (4.48, 0.16), (1.85, 0.05), (1.30, 0.05), (2.55, 0.10), (0.18, 0.02), (0.50, 0.03)),
)


def draw_car(rng: np.random.Generator) -> CarShape:
    """Draw one car from the classes by their shares."""
    shares = np.array([c.share for c in CLASSES])
    return draw_of_class(CLASSES[int(rng.choice(len(CLASSES), p=shares / shares.sum()))], rng)


def draw_of_class(kind: CarClass, rng: np.random.Generator) -> CarShape:
    """Draw one car of a class."""

    def near(mean: float, sigma: float) -> float:
        return float(mean + sigma * np.clip(rng.normal(), -2.5, 2.5))

    length, width, height = near(*kind.length), near(*kind.width), near(*kind.height)
    wheelbase, clearance = near(*kind.wheelbase), near(*kind.clearance)
    overhangs = length - wheelbase
    front_overhang = overhangs * near(0.47 if kind.style in ("saloon", "fastback", "pickup") else 0.50, 0.035)
    tall = (height - 1.46) / 0.3
    hood_front = height * near(*kind.hood)
    belt = height * near(0.63, 0.02)
    cowl_height = belt + near(0.03, 0.03)
    upright = kind.style == "van"
    run = near(0.78 - 0.10 * tall, 0.10) if not upright else near(0.65, 0.1)
    rear = _REARS[kind.style]
    deck_height = height * near(*rear.deck_height) if kind.style != "pickup" else near(1.02, 0.05)
    return CarShape(
        length=length,
        width=width,
        height=height,
        wheelbase=wheelbase,
        front_overhang=front_overhang,
        tyre_radius=near(0.325 + 0.025 * tall, 0.015),
        tyre_width=near(0.29, 0.025),
        wheel_inset=near(0.02, 0.015),
        clearance=clearance,
        chin=clearance + near(0.08, 0.03),
        chin_setback=near(0.03, 0.02),
        chin_length=float(np.clip(near(0.35, 0.10), 0.1, front_overhang - 0.36)),
        nose_height=near(0.50 + 0.10 * tall, 0.05),
        hood_front=hood_front,
        hood_setback=near(0.14, 0.05),
        hood_crown=near(0.05, 0.02),
        cowl_from_axle=near(0.42, 0.12) if not upright else near(0.1, 0.15),
        cowl_height=max(cowl_height, hood_front + 0.12),
        windshield_run=run,
        roof_front_drop=near(0.08, 0.02),
        roof_peak=near(0.38, 0.07),
        roof_rear_from_tail=near(*rear.roof_from_tail),
        roof_rear_drop=near(*rear.roof_drop),
        deck_from_tail=near(*rear.deck_from_tail),
        deck_height=deck_height,
        tail_height=deck_height - near(*rear.tail_below_deck),
        tail_setback=near(*rear.tail_setback),
        tail_bulge=near(0.50 + 0.08 * tall, 0.06),
        rear_lip=clearance + near(0.10, 0.04),
        rear_lip_setback=near(0.04, 0.03),
        departure=float(np.clip(near(0.55, 0.12), 0.1, overhangs - front_overhang - 0.36)),
        widest=height * near(0.42, 0.04),
        rocker_inset=near(0.06, 0.025),
        belt_height=belt,
        belt_rise=near(0.02, 0.012),
        belt_inset=near(0.05, 0.02),
        shoulder=near(0.03, 0.02),
        tumblehome=near(0.38 - 0.06 * tall, 0.06),
        taper_front=near(0.16, 0.04),
        taper_rear=near(0.12, 0.04),
        taper_lean=near(0.8, 0.4),
        glass_taper=near(0.07, 0.03),
        bow_front=near(0.22, 0.07),
        bow_rear=near(0.18, 0.06),
        bow_glass=near(0.15, 0.06),
        crown=near(0.06, 0.015),
        rounding=near(0.18, 0.05),
        rounding_low=near(0.12, 0.04),
        mirror_reach=near(0.07, 0.02),
        mirror_size=near(0.14, 0.02),
    )


@dataclass(frozen=True)
class Rear:
    """Statistics of a rear end: (mean, standard deviation), metres; deck height as a share of the height."""

    roof_from_tail: tuple[float, float]
    roof_drop: tuple[float, float]
    deck_from_tail: tuple[float, float]
    deck_height: tuple[float, float]
    tail_below_deck: tuple[float, float]
    tail_setback: tuple[float, float]


_REARS = {
    "saloon": Rear((1.08, 0.12), (0.09, 0.025), (0.50, 0.10), (0.70, 0.02), (0.02, 0.03), (0.07, 0.03)),
    "fastback": Rear((1.10, 0.15), (0.10, 0.03), (0.32, 0.08), (0.68, 0.03), (0.03, 0.03), (0.07, 0.03)),
    "hatch": Rear((0.58, 0.14), (0.09, 0.03), (0.20, 0.06), (0.68, 0.03), (0.10, 0.04), (0.07, 0.03)),
    "box": Rear((0.45, 0.12), (0.07, 0.025), (0.16, 0.05), (0.66, 0.03), (0.10, 0.04), (0.06, 0.03)),
    "van": Rear((0.22, 0.06), (0.04, 0.015), (0.10, 0.03), (0.60, 0.03), (0.12, 0.04), (0.05, 0.02)),
    "pickup": Rear((1.75, 0.15), (0.06, 0.02), (1.58, 0.12), (0.56, 0.02), (0.0, 0.02), (0.06, 0.02)),
}
