"""Draw vans from the published dimensions of their body types.

Small delivery vans (Kangoo, Berlingo, Caddy), vans of 3 t (Transporter, Vito, Trafic), vans of 3.5 t with a normal or
a high roof (Sprinter, Ducato, Transit), and forward-control vans whose cab stands over the front axle (HiAce, T3,
Sambar). Delivery vans and minibuses share these bodies. Tail lamps stand upright at the rear corners.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from meshslam.categories.procedural.car import CarShape
from meshslam.categories.procedural.heavy import NONE, Body, Measure, draw_body

_EYE_LEVEL_GLASS_M = (1.95, 0.07)  # top of a windshield over the ground: a higher roof is sheet metal above it


@dataclass(frozen=True)
class Van:
    """A body type and where vans of it carry glass and lamps; (mean, standard deviation), metres or shares."""

    body: Body
    frame: Measure  # glass below the roof where the roof is low
    lamps: Measure  # tail lamps' middle, as a share of the height
    tumblehome: Measure  # inward slope of the side above the belt, metres per metre


VANS = (
    Van(Body(0.26, "panel", (4.40, 0.15), (1.83, 0.03), (1.83, 0.03), (2.73, 0.08), (0.88, 0.04), (1.05, 0.08),
             (1.12, 0.04), (0.85, 0.08), NONE, NONE, (0.315, 0.012), (0.22, 0.025)),
        (0.14, 0.02), (0.57, 0.05), (0.14, 0.04)),  # small delivery van
    Van(Body(0.32, "panel", (5.05, 0.20), (1.93, 0.03), (1.95, 0.04), (3.10, 0.14), (0.95, 0.05), (0.78, 0.12),
             (1.22, 0.05), (0.90, 0.10), NONE, NONE, (0.335, 0.012), (0.23, 0.025)),
        (0.16, 0.03), (0.52, 0.05), (0.12, 0.04)),  # van of 3 t
    Van(Body(0.26, "panel", (5.75, 0.40), (2.03, 0.03), (2.52, 0.16), (3.52, 0.25), (1.00, 0.05), (0.72, 0.14),
             (1.32, 0.06), (0.85, 0.10), NONE, NONE, (0.345, 0.012), (0.26, 0.03)),
        (0.18, 0.03), (0.42, 0.05), (0.06, 0.02)),  # van of 3.5 t
    Van(Body(0.16, "panel", (4.35, 0.40), (1.68, 0.06), (1.92, 0.06), (2.40, 0.20), (1.08, 0.10), (0.22, 0.08),
             (1.12, 0.06), (0.52, 0.08), NONE, NONE, (0.305, 0.012), (0.22, 0.025)),
        (0.16, 0.03), (0.46, 0.05), (0.10, 0.04)),  # forward-control van
)  # fmt: skip


def draw_van(rng: np.random.Generator) -> CarShape:
    """Draw one van from the body types by their shares."""
    shares = np.array([van.body.share for van in VANS])
    return draw_of_van(VANS[int(rng.choice(len(VANS), p=shares / shares.sum()))], rng)


def draw_of_van(van: Van, rng: np.random.Generator) -> CarShape:
    """Draw one van of a body type."""

    def near(mean: float, sigma: float) -> float:
        return float(mean + sigma * np.clip(rng.normal(), -2.5, 2.5))

    body = draw_body(van.body, rng)
    frame = near(*van.frame)
    windshield_top = max(frame, body.height - near(*_EYE_LEVEL_GLASS_M))
    window_top = max(near(*van.frame), windshield_top + near(0.0, 0.04))
    high_roof = windshield_top > 0.3
    return replace(
        body,
        roof_front_drop=windshield_top - 0.05 if high_roof else near(0.09, 0.02),
        roof_peak=near(0.30, 0.05),
        roof_rear_from_tail=near(0.16, 0.04),
        deck_from_tail=near(0.08, 0.02),
        deck_height=min(near(0.57, 0.03) * body.height, near(1.22, 0.06)),
        tumblehome=near(*van.tumblehome),
        windshield_share=near(0.70, 0.03),
        window_share=near(0.68, 0.04),
        light_share=near(0.62, 0.04) * body.cowl_height / body.height,
        trunk_share=near(*van.lamps),
        windshield_top=windshield_top,
        window_top=window_top,
    )
