"""The map from above: the camera's path, the objects' footprints, how surely they stand where they are drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import cv2
import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.maps import Map, MapObject, object_colour
from meshslam.viewing.markup import px, rgb, size_m, text

WIDTH_PX, TALLEST_PX, MARGIN_PX, LOWEST_PX = 1160.0, 620.0, 44.0, 200.0
LARGEST_SCALE = 45.0  # px/m
SCALE_BAR_PX = 140.0  # at most
BAND_PX = 24.0  # below the drawing, for scale and axes
LABELLED_INSIDE_PX = 17.0  # width of a footprint that holds its own number
PATH_POINTS = 2000
OTHER_COLOURS = ("#2c9f5f", "#c62f5b", "#8250df", "#9aa0a6")


@dataclass(frozen=True, eq=False)
class Plan:
    """How the ground is laid on paper: turned, so that the path runs across, one scale for both axes, y up."""

    rotation: Floats  # (2, 2), paper's axes (right, up) from world's x, y
    scale_px_per_m: float
    origin: Floats  # (2,), what lies at the left and bottom, metres along the paper's axes
    width_px: float
    height_px: float
    margin: Floats  # (2,), from the left and from the bottom, px

    def pixels(self, points_in_world: Floats) -> Floats:
        """Pixels (..., 2) of points (..., 2 or 3)."""
        paper = (points_in_world[..., :2] @ self.rotation.T - self.origin) * self.scale_px_per_m + self.margin
        paper[..., 1] = self.height_px - paper[..., 1]
        return paper


def make_plan(path_in_world: Floats, points_in_world: Floats) -> Plan:
    """Fit a path (n, 3) and other points (m, 3) on the paper."""
    rotation = _across(path_in_world if len(path_in_world) > 1 else points_in_world)
    everything = np.concatenate([path_in_world, points_in_world])[:, :2] @ rotation.T
    low = everything.min(axis=0) if len(everything) else np.zeros(2)
    size = np.maximum((everything.max(axis=0) if len(everything) else np.ones(2)) - low, 1.0)
    room = np.array([WIDTH_PX, TALLEST_PX]) - 2 * MARGIN_PX
    scale = min(float((room / size).min()), LARGEST_SCALE)
    height = max(float(size[1]) * scale + 2 * MARGIN_PX, LOWEST_PX)
    margin = (np.array([WIDTH_PX, height]) - size * scale) / 2
    return Plan(rotation, scale, low, WIDTH_PX, height, margin)


def birds_eye(
    scene_map: Map,
    world_from_camera: Sequence[Pose],
    other_paths: Mapping[str, Sequence[Pose]] = MappingProxyType({}),
) -> str:
    """Draw an SVG: path from its dot to its arrow, footprints with a tick at the front, 1-sigma ellipses, a scale.

    Other paths, such as truth or that of the IMU alone, are thin lines under their names.
    """
    path = _positions(world_from_camera)
    others = {name: _positions(poses) for name, poses in other_paths.items()}
    corners = [footprint(thing) for thing in scene_map.objects]
    flat = np.concatenate([np.zeros((0, 2)), *corners])
    points = np.concatenate([np.column_stack([flat, np.zeros(len(flat))]), *others.values()])
    plan = make_plan(path, points)
    cars = "".join(_object(plan, thing, hull) for thing, hull in zip(scene_map.objects, corners, strict=True))
    size = f"{px(plan.width_px)} {px(plan.height_px + BAND_PX)}"
    return (
        f'<svg class=plan role=img aria-label="view from above" viewBox="0 0 {size}">'
        f"{_other_paths(plan, others)}{_path(plan, path)}{cars}{_scale_bar(plan)}{_axes(plan)}</svg>"
    )


def _positions(poses: Sequence[Pose]) -> Floats:
    return np.array([pose.translation for pose in poses]).reshape(-1, 3)


def _other_paths(plan: Plan, paths: Mapping[str, Floats]) -> str:
    """Thin lines, and a legend at the upper left."""
    parts = []
    for i, (name, path) in enumerate(paths.items()):
        colour, pixels = OTHER_COLOURS[i % len(OTHER_COLOURS)], plan.pixels(path[:: len(path) // PATH_POINTS + 1])
        parts.append(f'<polyline fill="none" stroke="{colour}" stroke-width="1.5" points="{_joined(pixels)}"/>')
        parts.append(f'<path stroke="{colour}" stroke-width="3" d="M16,{18 + 18 * i}h22"/>')
        parts.append(f'<text x="46" y="{22 + 18 * i}" style="text-anchor:start">{text(name)}</text>')
    return "".join(parts)


def footprint(thing: MapObject) -> Floats:
    """Convex hull (n, 2) of an object's mesh from above, in world, metres."""
    flat = thing.vertices_in_world[:, :2]
    centre = flat.mean(axis=0)
    hull = cv2.convexHull((flat - centre).astype(np.float32))
    corners: Floats = np.asarray(hull, float).reshape(-1, 2) + centre
    return corners


def position_covariance(thing: MapObject) -> Floats | None:
    """Covariance (3, 3) of an object's position in world, m²."""
    if thing.pose_covariance is None:
        return None
    rotation = thing.world_from_object.rotation
    turned: Floats = rotation @ thing.pose_covariance[:3, :3] @ rotation.T
    return turned


def round_length_m(longest_m: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is no longer."""
    power = 10.0 ** np.floor(np.log10(longest_m))
    return float(max(step * power for step in (1, 2, 5) if step * power <= longest_m * (1 + 1e-9)))


def _across(points: Floats) -> Floats:
    """Turn the points' main direction to the right, in the order in which they come."""
    flat = points[:, :2] - points[:, :2].mean(axis=0) if len(points) else np.zeros((1, 2))
    _, spread, axes = np.linalg.svd(flat, full_matrices=True)
    if spread[0] < 1e-6:
        return np.eye(2)
    right = axes[0] if (flat[-1] - flat[0]) @ axes[0] >= 0 else -axes[0]
    return np.array([right, [-right[1], right[0]]])


def _joined(pixels: Floats) -> str:
    return " ".join(f"{px(x)},{px(y)}" for x, y in pixels.tolist())


def _path(plan: Plan, path: Floats) -> str:
    if not len(path):
        return ""
    pixels = plan.pixels(path[:: len(path) // PATH_POINTS + 1])
    start, end = pixels[0], plan.pixels(path[-1])
    dot = f'<circle class=start cx="{px(start[0])}" cy="{px(start[1])}" r="4"/>'
    moved = np.linalg.norm(pixels - end, axis=1) > 6
    if not moved.any():
        return dot
    along = end - pixels[np.flatnonzero(moved)[-1]]
    along /= np.linalg.norm(along)
    across = np.array([-along[1], along[0]])
    arrow = np.array([end + 9 * along, end - 3 * along + 5 * across, end - 3 * along - 5 * across])
    line = np.concatenate([pixels, end[None]])
    return f'<polyline class=path points="{_joined(line)}"/>{dot}<polygon class=end points="{_joined(arrow)}"/>'


def _object(plan: Plan, thing: MapObject, hull: Floats) -> str:
    colour = rgb(object_colour(thing.id))
    centre = plan.pixels(thing.world_from_object.translation)
    nose = thing.world_from_object.transform(np.array([[0.5, 0.0, 0.0], [0.62, 0.0, 0.0]]) * thing.dimensions[0])
    tick = plan.pixels(nose)
    drawn = plan.pixels(hull)
    wide = float(min(thing.dimensions[:2])) * plan.scale_px_per_m
    beside = 0.0 if wide >= LABELLED_INSIDE_PX else float(np.ptp(drawn[:, 1])) / 2 + 9
    title = f"{text(thing.category)} {thing.id}: {size_m(thing.dimensions)} m"
    return (
        f'<g class=car data-id="{thing.id}"><title>{title}</title>'
        f'<polygon points="{_joined(drawn)}" fill="{colour}" stroke="{colour}"/>'
        f'<polyline class=nose points="{_joined(tick)}" stroke="{colour}"/>{_ellipse(plan, thing, centre)}'
        f'<text x="{px(centre[0])}" y="{px(centre[1] - beside + 4)}">{thing.id}</text></g>'
    )


def _ellipse(plan: Plan, thing: MapObject, centre: Floats) -> str:
    covariance = position_covariance(thing)
    if covariance is None:
        return ""
    values, axes = np.linalg.eigh(plan.rotation @ covariance[:2, :2] @ plan.rotation.T)
    radii = np.sqrt(np.maximum(values, 0)) * plan.scale_px_per_m
    angle = -np.degrees(np.arctan2(axes[1, 1], axes[0, 1]))
    place = f"translate({px(centre[0])} {px(centre[1])}) rotate({px(float(angle))})"
    return f'<ellipse rx="{radii[1]:.2f}" ry="{radii[0]:.2f}" transform="{place}"/>'


def _scale_bar(plan: Plan) -> str:
    length_m = round_length_m(SCALE_BAR_PX / plan.scale_px_per_m)
    length, y = length_m * plan.scale_px_per_m, plan.height_px + BAND_PX - 14
    line = f"M16,{px(y - 5)}v5h{length:.2f}v-5"
    return f'<g class=scale><path d="{line}"/><text x="{px(22 + length)}" y="{px(y)}">{length_m:g} m</text></g>'


def _axes(plan: Plan) -> str:
    """The world's x and y, at the right below the drawing."""
    centre = np.array([plan.width_px - 40, plan.height_px + BAND_PX - 38])
    parts = []
    for name, direction in zip("xy", plan.rotation.T, strict=True):
        tip, word = (centre + length * direction * [1, -1] for length in (20, 30))
        parts.append(f'<path d="M{_joined(centre[None])}L{_joined(tip[None])}"/>')
        parts.append(f'<text x="{px(word[0])}" y="{px(word[1] + 4)}">{name}</text>')
    return f"<g class=axes>{''.join(parts)}</g>"
