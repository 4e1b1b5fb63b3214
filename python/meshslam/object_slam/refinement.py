"""The map of a run: the graph's objects, fitted once more along the smoothed path."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from meshslam.geometry import Pose
from meshslam.mapping import ObjectMapping, map_objects
from meshslam.maps import CameraPath, Trajectory
from meshslam.object_slam.landmarks import Landmark
from meshslam.object_slam.setup import SlamSetup
from meshslam.perception import DetectionSet


def best_landmarks(landmarks: Mapping[int, Landmark], joined: Mapping[int, int]) -> dict[int, Landmark]:
    """Each track's landmark; of several stays in view the one with most observations counts."""
    best: dict[int, Landmark] = {}
    for mark in landmarks.values():
        track = joined.get(mark.track, mark.track)
        if mark.counts and (track not in best or mark.views > best[track].views):
            best[track] = mark
    return best


def starts_of(
    landmarks: Mapping[int, Landmark],
    world_from_object: Mapping[int, Pose],
    joined: Mapping[int, int],
    world_from_graph: Pose,
) -> dict[int, Pose]:
    """Where each track's object stands in the graph."""
    best = best_landmarks(landmarks, joined)
    return {track: world_from_graph @ world_from_object[mark.number] for track, mark in best.items()}


def refined_mapping(
    setup: SlamSetup,
    frame_ids: Sequence[int],
    path: Trajectory,
    detections: DetectionSet,
    starts: Mapping[int, Pose],
    *,
    fixed_tracks: bool,
    progress: Callable[[str, int, int], None] | None,
) -> tuple[ObjectMapping, tuple[str, ...]]:
    """The map, and notes for the user on how it was made."""
    frames = CameraPath(
        setup.camera, tuple(frame_ids), path.times_s, path.world_from_camera, setup.height_above_ground_m
    )
    mapping = map_objects(
        frames,
        detections,
        setup.category,
        setup.objects,
        setup.mapping,
        starts=starts,
        fixed_tracks=fixed_tracks,
        progress=progress,
    )
    ids = set(mapping.map)
    return mapping, tuple(_notes(ids & set(starts), ids - set(starts), set(starts) - ids))


def _notes(refined: set[int], added: set[int], lost: set[int]) -> list[str]:
    notes = [f"map: {len(refined)} objects of the graph were fitted once more along the smoothed path"]
    if added:
        notes.append(
            f"map: {len(added)} objects were seen too briefly for the graph, and found along the smoothed path: "
            f"{_listed(added)}"
        )
    if lost:
        notes.append(
            f"map: {len(lost)} objects of the graph are not in the map (left out, with the reason): {_listed(lost)}"
        )
    return notes


def _listed(numbers: set[int]) -> str:
    first = ", ".join(map(str, sorted(numbers)[:10]))
    return first if len(numbers) <= 10 else f"{first}, …"
