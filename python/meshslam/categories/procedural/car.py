"""A parametric car: its solid, its landmarks and its key points.

Frame of this module: x forward from the middle of the wheelbase, y left, z up from the ground, metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import map_coordinates

from meshslam.categories.procedural.solid import cast, curve_distance, project, smooth_max, smooth_min, smooth_step
from meshslam.geometry import Floats

GRID = 0.03  # metres between samples of the profile's distance field
MIRROR_FOOT = 0.12  # the mirror's foot inside the car's widest line
TYRE_SHOULDER = 0.08  # over which a tyre is rounded
GLASS_BELOW_ROOF = 0.09  # the glass's upper edge lies below the roof by its frame and the roof's crown


@dataclass(frozen=True)
class CarShape:
    """Measures of a car, in metres unless said otherwise."""

    length: float
    width: float  # without mirrors
    height: float
    wheelbase: float
    front_overhang: float
    tyre_radius: float
    tyre_width: float
    wheel_inset: float  # tyre's outer face inside the body's widest line
    clearance: float  # underbody above the ground
    chin: float  # lower edge of the front bumper
    chin_setback: float
    chin_length: float  # length of the rise ahead of the front wheels
    nose_height: float  # foremost point
    hood_front: float  # height of the hood's leading edge
    hood_setback: float  # how far that edge lies behind the foremost point
    hood_crown: float
    cowl_from_axle: float  # windshield's base behind the front axle
    cowl_height: float
    windshield_run: float  # horizontal length of the windshield
    roof_front_drop: float  # windshield's top below the roof's highest point
    roof_peak: float  # share of the roof's length, from the front
    roof_rear_from_tail: float  # rear window's top ahead of the tail
    roof_rear_drop: float
    deck_from_tail: float  # rear window's base ahead of the tail
    deck_height: float
    tail_height: float  # rear edge of the deck, or sill of the hatch's window
    tail_setback: float
    tail_bulge: float  # height of the rearmost point
    rear_lip: float  # lower edge of the rear bumper
    rear_lip_setback: float
    departure: float  # length of the rise behind the rear wheels
    widest: float  # height of the widest line
    rocker_inset: float
    belt_height: float
    belt_rise: float  # slope of the belt line, rising to the rear
    belt_inset: float
    shoulder: float  # step inwards at the belt line
    tumblehome: float  # inward slope of the side glass, metres per metre
    taper_front: float  # share of half width lost at the very front
    taper_rear: float
    taper_lean: float  # how much more the tapers take per metre of height
    glass_taper: float  # share of half width the greenhouse loses at its rear end
    bow_front: float  # how far the front recedes at the sides
    bow_rear: float
    bow_glass: float
    crown: float  # how far the roof and hood fall to the sides
    rounding: float
    rounding_low: float
    mirror_reach: float  # mirror's tip beyond the widest line
    mirror_size: float  # half its height at its foot
    tension: float = 0.45  # roundness of the profile at its control points
    windshield_share: float = 0.58  # where the windshield's upper corners are, as a share of half the width
    window_share: float = 0.54  # likewise of the rear window
    light_share: float = 0.43  # height of the front lights, as a share of the height
    trunk_share: float = 0.60  # height of the trunk's corners, likewise
    windshield_top: float = GLASS_BELOW_ROOF  # the windshield's upper corners below the roof
    window_top: float = GLASS_BELOW_ROOF  # likewise of the rear window

    @property
    def front(self) -> float:
        """The x of the foremost point."""
        return self.wheelbase / 2 + self.front_overhang

    @property
    def rear(self) -> float:
        """The x of the rearmost point."""
        return self.front - self.length

    @cached_property
    def controls(self) -> Floats:
        """The (14, 2) named points (x, z) of the side profile, from under the nose over the roof to under the tail."""
        f, r, h = self.front, self.rear, self.height
        cowl = self.wheelbase / 2 - self.cowl_from_axle
        roof = cowl - self.windshield_run
        roof_rear = r + self.roof_rear_from_tail
        lead = np.array([f - self.hood_setback, self.hood_front])
        base = np.array([cowl, self.cowl_height])
        return np.array(
            [
                (f - self.chin_length, self.clearance),
                (f - self.chin_setback, self.chin),
                (f, self.nose_height),
                lead,
                (lead + base) / 2 + [0, self.hood_crown],
                base,
                (roof, h - self.roof_front_drop),
                (roof + self.roof_peak * (roof_rear - roof), h),
                (roof_rear, h - self.roof_rear_drop),
                (r + self.deck_from_tail, self.deck_height),
                (r + self.tail_setback, self.tail_height),
                (r, self.tail_bulge),
                (r + self.rear_lip_setback, self.rear_lip),
                (r + self.departure, self.clearance),
            ]
        )

    @cached_property
    def profile(self) -> Floats:
        """The side profile as a closed polygon (n, 2) of (x, z), with the exact length and height."""
        curve = cardinal_spline(self.controls, self.tension)
        low, high = curve.min(0), curve.max(0)
        low_target, high_target = np.array([self.rear, self.clearance]), np.array([self.front, self.height])
        scaled: Floats = low_target + (curve - low) / (high - low) * (high_target - low_target)
        return scaled

    def field(self, points: Floats) -> Floats:
        """Value (n,) at points (n, 3): negative inside, roughly metres near the surface."""
        p = np.column_stack([points[:, 0], np.abs(points[:, 1]), points[:, 2]])
        return smooth_min(smooth_min(self._body(p), self._wheels(p), 0.02), self._mirrors(p), 0.02)

    def half_width(self, x: Floats, z: Floats) -> Floats:
        """Half width of the body at (x, z), before its edges are rounded."""
        belt = self.belt_height - self.belt_rise * x
        low = np.clip((self.widest - z) / (self.widest - self.clearance), 0, 1.5)
        high = np.clip((z - self.widest) / (belt - self.widest), 0, 1)
        lower = self.width / 2 - self.rocker_inset * low**2 - self.belt_inset * high**2
        inward = self.tumblehome * smooth_ramp(z - belt, 0.08) + self.shoulder * smooth_step((z - belt) / 0.12 + 0.3)
        ahead = (x - self.wheelbase / 2 + 0.3) / (self.front_overhang + 0.3)
        behind = (-self.wheelbase / 2 + 0.3 - x) / (-self.wheelbase / 2 + 0.3 - self.rear)
        taper = self.taper_front * smooth_ramp(ahead, 0.1) ** 2 + self.taper_rear * smooth_ramp(behind, 0.1) ** 2
        plan = 1 - taper * np.maximum(1 + self.taper_lean * np.minimum(z - 0.55, 0.5), 0.3)
        back = np.clip((0.2 - x) / (0.2 - self.rear), 0, 1.2)
        share = smooth_step((z - belt) / (self.height - belt))
        return lower * plan - inward - self.glass_taper * share * back**2 * self.width / 2

    def landmarks(self) -> Floats:
        """Points (n, 3) that mean the same place on every car, in pairs y and -y."""
        controls = self._on_profile
        x, z = controls.T
        rows = [np.column_stack([x, 0 * x, z])]
        rows += [np.column_stack([self._swept(x, z, s), s * self.half_width(x, z), z]) for s in (0.5, 0.92)]
        rows.append(self._side_landmarks())
        rows.append(self._wheel_landmarks())
        reach, size = self.mirror_reach + MIRROR_FOOT, self.mirror_size
        around = [(0, 0, 0), (0, -reach, size), (0, -reach, -size), (size, -reach, 0), (-size, -reach, 0)]
        rows.append(self.mirror_tip + np.array(around))
        half = np.concatenate(rows)
        return np.concatenate([half, half[half[:, 1] > 1e-9] * [1, -1, 1]])

    def keypoints(self) -> Floats:
        """Return the 12 key points (12, 3) in the order of KEYPOINT_NAMES.

        Wheels: the hub on the tyre's outer face. Glass corners: where the middle of the roof line has fallen to the
        glass's top, at the pillars. Lights and trunk corners: on the surface at their share of the height.
        """
        w, h = self.width / 2, self.height
        cowl = self.wheelbase / 2 - self.cowl_from_axle
        middle = (cowl - self.windshield_run + self.rear + self.roof_rear_from_tail) / 2
        inside = np.array(
            [
                [middle, 0, h - self.windshield_top],
                [middle, 0, h - self.window_top],
                [0, 0.75 * w, self.light_share * h],
                [0, 0.75 * w, self.trunk_share * h],
            ]
        )
        ahead = np.array([[1.0, 0, 0], [-1.0, 0, 0], [1.0, 0, 0], [-1.0, 0, 0]])
        reach = 4.0 * np.ceil(self.length / 6.5)
        windshield, window, light, trunk = cast(self.field, inside, ahead, reach)
        pillars = np.array([windshield + [0, self.windshield_share * w, 0], window + [0, self.window_share * w, 0]])
        windshield, window = project(self.field, pillars)
        hub = [self.wheelbase / 2, w - self.wheel_inset, self.tyre_radius]
        left = [hub, np.multiply(hub, [-1, 1, 1]), windshield, window, light, trunk]
        return np.array([left[i] * np.array([1, s, 1]) for i, s in _KEYPOINT_ORDER])

    def _body(self, p: Floats) -> Floats:
        x, y, z = p.T
        q = y / (self.width / 2)
        side = np.interp(z, [0.5, 0.9], [self.rounding_low, self.rounding])
        profile = self._profile_distance(self._unswept(x, q, z), z + self.crown * q**2 * smooth_step((z - 0.5) / 0.3))
        return smooth_max(profile, y - self.half_width(x, z), side)

    def _wheels(self, p: Floats) -> Floats:
        x, y, z = p.T
        radial = np.hypot(np.abs(x) - self.wheelbase / 2, z - self.tyre_radius) - self.tyre_radius
        outer = self.width / 2 - self.wheel_inset
        across = np.abs(y - outer + self.tyre_width / 2) - self.tyre_width / 2
        return smooth_max(radial, across, TYRE_SHOULDER)

    @property
    def mirror_tip(self) -> Floats:
        """The middle of the left mirror's outer face."""
        x = self.wheelbase / 2 - self.cowl_from_axle - 0.6 * self.windshield_run
        return np.array([x, self.width / 2 + self.mirror_reach, self.belt_height - self.belt_rise * x + 0.06])

    def _mirrors(self, p: Floats) -> Floats:
        """Blunt cones that stand on the side glass: as much of a mirror as one vertex can show."""
        x, y, z = (p - self.mirror_tip).T
        depth = self.mirror_reach + MIRROR_FOOT
        value: Floats = np.hypot(x, z) + self.mirror_size * np.maximum(y, -depth) / depth
        return value

    def _sweep(self, x: Floats, z: Floats) -> Floats:
        """How far the profile's x recedes (positive: rearwards) at full half width."""
        ahead = smooth_step((x - 0.1) / (self.front - 0.6))
        behind = smooth_step((-x - 0.3) / (-self.rear - 0.8))
        high = smooth_step((z - self.belt_height + 0.1) / 0.3)
        return ahead * (self.bow_front * (1 - high) + self.bow_glass * high) - behind * self.bow_rear

    def _unswept(self, x: Floats, q: Floats, z: Floats) -> Floats:
        return x + self._sweep(x, z) * q**2

    def _swept(self, x: Floats, z: Floats, q: float) -> Floats:
        y: Floats = x - self._sweep(x, z) * q**2
        return y

    def _profile_distance(self, x: Floats, z: Floats) -> Floats:
        origin, table = self._distance_table
        at = (np.stack([x, z]) - origin[:, None]) / GRID
        values: Floats = map_coordinates(table, at, order=1, mode="nearest")
        return values

    @cached_property
    def _distance_table(self) -> tuple[Floats, Floats]:
        low, high = self.profile.min(0) - 0.6, self.profile.max(0) + 0.6
        x, z = (np.arange(low[i], high[i] + GRID, GRID) for i in range(2))
        points = np.stack(np.meshgrid(x, z, indexing="ij"), -1).reshape(-1, 2)
        return low, curve_distance(points, self.profile).reshape(len(x), len(z))

    @cached_property
    def _on_profile(self) -> Floats:
        """The control points where the scaled profile passes them."""
        return self.profile[:: len(self.profile) // len(self.controls)]

    def _side_landmarks(self) -> Floats:
        f, r, a = self.front, self.rear, self.wheelbase / 2
        x = np.array([f - 0.35, a, a - 0.6, 0.0, -a + 0.6, -a, r + 0.35])
        rows = []
        for height in (self.clearance + 0.05, self.widest):
            z = np.full(len(x), height)
            rows.append(np.column_stack([x, self.half_width(x, z), z]))
        inner = x[2:6]
        z = self.belt_height - self.belt_rise * inner
        rows.append(np.column_stack([inner, self.half_width(inner, z), z]))
        return np.concatenate(rows)

    def _wheel_landmarks(self) -> Floats:
        outer, r, c = self.width / 2 - self.wheel_inset, self.tyre_radius, self.clearance
        chord = np.sqrt(max(r * r - (r - c) ** 2, 0.01))
        section = np.array([(-chord, c), (-chord * 0.5, c * 0.16), (0, 0), (chord * 0.5, c * 0.16), (chord, c), (0, r)])
        rows = [
            (axle + dx, y, dz)
            for axle in (self.wheelbase / 2, -self.wheelbase / 2)
            for y in (outer, outer - self.tyre_width)
            for dx, dz in section
        ]
        return np.array(rows)


_KEYPOINT_ORDER = [(0, 1), (1, 1), (0, -1), (1, -1), (2, 1), (2, -1), (3, 1), (3, -1), (4, 1), (4, -1), (5, 1), (5, -1)]


def smooth_ramp(t: Floats, width: float) -> Floats:
    """Return max(t, 0), rounded over `width`."""
    return smooth_max(t, np.zeros_like(t), width)


def cardinal_spline(points: Floats, tension: float, samples: int = 12) -> Floats:
    """Closed curve (n * samples, 2) through points (n, 2); `tension` scales its tangents.

    Tangents follow the direction between the neighbours with the length of the shorter side, so that a long side
    beside a short one does not overshoot.
    """
    ahead, behind = np.roll(points, -1, axis=0) - points, points - np.roll(points, 1, axis=0)
    la, lb = np.linalg.norm(ahead, axis=1, keepdims=True), np.linalg.norm(behind, axis=1, keepdims=True)
    direction = ahead / la + behind / lb
    direction = direction / np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-9)
    tangent = tension * direction * np.minimum(la, lb) * 2
    t = np.linspace(0, 1, samples, endpoint=False)[:, None, None]
    start, end = points, np.roll(points, -1, axis=0)
    out, arrive = np.minimum(1, la / np.minimum(la, lb)) * tangent, np.roll(tangent, -1, axis=0)
    curve = (
        (2 * t**3 - 3 * t**2 + 1) * start
        + (t**3 - 2 * t**2 + t) * out
        + (3 * t**2 - 2 * t**3) * end
        + (t**3 - t**2) * arrive
    )
    spline: Floats = curve.transpose(1, 0, 2).reshape(-1, 2)
    return spline
