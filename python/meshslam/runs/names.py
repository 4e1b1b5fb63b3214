"""What to tell a user who gives a setting that is not known: what it is called now, or which names are near."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches

import yaml

from meshslam.runs.commands import uses, why_unused
from meshslam.settings import Setting

_NAMED, _LONGEST = 8, 80  # of the settings that are there; characters of a name that is shown

# names of version 0.1: groups, then settings in the groups that they are in now
GROUPS = {
    "mapping.gradient": "objects.gradient",
    "mapping.noise": "objects.noise",
    "mapping.rotations": "rotations",
    "mapping": "objects",
    "localization.imu": "estimation.imu",
    "localization.start": "estimation.start",
    "localization.alignment": "estimation.unknown_start.alignment",
    "localization.smoother": "estimation.smoother",
    "slam.revisit": "slam.loop_closure",
}
RENAMED = {
    "segmentation.minimum_area_px": "segmentation.min_area_px",
    "segmentation.maximum_instances": "segmentation.max_instances",
    "segmentation.longest_side_px": "segmentation.max_side_px",
    "colour.least_area_px": "colour.min_area_px",
    "colour.least_point_px": "colour.min_point_px",
    "colour.least_ring": "colour.min_ring",
    "colour.largest_gap": "colour.max_gap",
    "keypoints.least_box_px": "keypoints.min_box_px",
    "tracking.minimum_score": "tracking.min_score",
    "tracking.minimum_overlap": "tracking.min_overlap",
    "tracking.maximum_gap": "tracking.max_gap",
    "rotations.minimum_corners": "rotations.min_corners",
    "rotations.minimum_baseline_m": "rotations.min_baseline_m",
    "objects.view_min_box_px": "objects.min_view_box_px",
    "objects.keypoint_min_score": "objects.min_keypoint_score",
    "objects.keypoint_min_sigma_px": "objects.min_keypoint_sigma_px",
    "objects.gradient.keypoint_min_score": "objects.gradient.min_keypoint_score",
    "estimation.imu.minimum_rate_hz": "estimation.imu.min_rate_hz",
    "estimation.start.unknown_tilt_sigma_deg": "estimation.unknown_start.tilt_sigma_deg",
    "estimation.start.unknown_velocity_sigma_m_s": "estimation.unknown_start.velocity_sigma_m_s",
    "estimation.start.unknown_velocity_share": "estimation.unknown_start.velocity_sigma_share",
    "estimation.start.settling_s": "estimation.unknown_start.settling_s",
    "estimation.start.settling_rounds": "estimation.unknown_start.max_settling_rounds",
    "localization.association.minimum_iou": "localization.association.min_iou",
    "localization.association.minimum_iou_same_id": "localization.association.min_iou_same_id",
    "localization.association.largest_distance_m": "localization.association.max_distance_m",
    "localization.gate.largest_cost": "localization.gate.max_cost",
    "localization.minimum_box_px": "localization.min_box_px",
    "localization.keypoint_position_sigma_m": "localization.noise.keypoint_position_sigma_m",
    "localization.joint_gradient_iterations": "slam.gradient_iterations",
    "slam.start_baseline_m": "slam.min_baseline_m",
    "slam.start_box_px": "slam.min_box_px",
    "slam.largest_cost": "slam.max_cost",
    "slam.minimum_mask_iou": "slam.min_mask_iou",
    "slam.whole_iterations": "slam.full_trajectory_iterations",
    "slam.loop_closure.views": "slam.loop_closure.min_views",
    "slam.loop_closure.nearest_m": "slam.loop_closure.max_distance_m",
    "slam.loop_closure.largest_radius_m": "slam.loop_closure.max_radius_m",
    "slam.loop_closure.apart_m": "slam.loop_closure.min_separation_m",
    "slam.loop_closure.objects": "slam.loop_closure.min_objects",
    "slam.loop_closure.sure_radius_m": "slam.loop_closure.single_object_radius_m",
    "slam.points.shortest": "slam.points.min_frames",
    "slam.road.nearest_m": "slam.road.min_distance_m",
    "slam.road.farthest_m": "slam.road.max_distance_m",
    "slam.road.baseline_m": "slam.road.min_baseline_m",
    "slam.road.minimum_correlation": "slam.road.min_correlation",
    "slam.road.minimum_drop": "slam.road.min_drop",
}
GONE = {
    "localization.noise.surface_sigma_m": "a map's meshes are taken as they are",
    "localization.noise.free_form_sigma_m": "a map's meshes keep their shape",
    "localization.noise.smoothness_sigma_m": "a map's meshes keep their shape",
}


def new_name(path: str, known: Mapping[str, Setting]) -> str | None:
    """What a setting of version 0.1 is called now; None if there was none of that name."""
    ways = [old for old in GROUPS if path.startswith(f"{old}.")]
    moved = [GROUPS[old] + path.removeprefix(old) for old in sorted(ways, key=len, reverse=True)]
    for place in (path, *moved):
        name = RENAMED.get(place, place)
        if name in known and name != path:
            return name
    return None


def advice(path: str, value: object, known: Mapping[str, Setting], command: str | None = None) -> str:
    """What is wrong with a setting that is not known, and what to do."""
    while isinstance(value, dict) and value:  # an old group: its first setting
        key, value = next(iter(value.items()))
        path = f"{path}.{key}"
    if path in GONE:
        return f"{path} is no setting any more, {GONE[path]}: remove it"
    new = new_name(path, known)
    if new is not None and command is not None and not uses(command, new):
        return f"{path} is called {new} now, and {why_unused(command, new)}"
    if new is not None:
        return f"{path} is called {new} now: write {written(new, value, known)}"
    near, shown = _near(path, known), path if len(path) <= _LONGEST else f"{path[:_LONGEST]}..."
    if near:
        return f"unknown setting {shown}: did you mean {' or '.join(near)}?"
    group = path.rpartition(".")[0]
    there = [
        name.removeprefix(f"{group}." if group else "").partition(".")[0] for name in known if name.startswith(group)
    ]
    found = list(dict.fromkeys(there))
    more = ", ..." if len(found) > _NAMED else ""
    return f"unknown setting {shown}, known there are {', '.join(found[:_NAMED])}{more} (docs/settings.md)"


def written(path: str, value: object, known: Mapping[str, Setting]) -> str:
    """A setting as it stands in a file, such as `expert: {slam: {size_sigma: 1.0}}`."""
    tree = value
    for key in reversed([*(["expert"] if known[path].about.kind == "expert" else []), *path.split(".")]):
        tree = {key: tree}
    text: str = yaml.safe_dump(tree, default_flow_style=True, width=10**6).strip()
    return text.removeprefix("{").removesuffix("}")


def _near(path: str, known: Mapping[str, Setting]) -> list[str]:
    """Settings of nearly that name or group, those of that name elsewhere, else of nearly that name elsewhere."""
    group, _, leaf = path.rpartition(".")
    by_leaf: dict[str, list[str]] = {}
    for name in known:
        by_leaf.setdefault(name.rpartition(".")[2], []).append(name)
    same_group = [name for name in known if name.rpartition(".")[0] == group]
    near = get_close_matches(path, same_group, 1, 0.8) or get_close_matches(path, known, 1, 0.85)
    others = by_leaf.get(leaf) or [n for found in get_close_matches(leaf, by_leaf, 1, 0.75) for n in by_leaf[found]]
    if near and (leaf not in by_leaf or near[0].endswith(f".{leaf}")):
        return near
    return [*near, *others][:3]
