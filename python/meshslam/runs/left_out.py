"""left_out.json: what a run did not use, each with the reason; and a note where that is nearly everything."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from meshslam.maps import RunDirectory
from meshslam.perception import voted_category
from meshslam.runs.outlet import Outlet

if TYPE_CHECKING:
    from meshslam.localization import Localization
    from meshslam.mapping import ObjectMapping

LEFT_OUT = "left_out.json"


def save_left_out_tracks(mapping: ObjectMapping, run: RunDirectory, outlet: Outlet) -> None:
    """Write every track that is not in the map, with its reason; a note tells if nothing is in the map."""
    reasons = {row.track: row for row in mapping.left_out}
    moving = {thing.id for thing in mapping.map.moving}
    tracks: list[dict[str, Any]] = []
    for number, found in sorted(mapping.tracked.by_track().items()):
        if number in mapping.map or number in moving:
            continue
        row = reasons.get(number)
        tracks.append(
            {
                "track_id": number,
                "category": voted_category(found),
                "frames": sorted({d.frame for d in found}),
                "reason": code(row.reason if row else "joined"),
                "detail": row.detail if row else "its detections were given to another track",
            }
        )
    run.save(LEFT_OUT, _json("tracks", tracks))
    if not mapping.map:
        outlet.note(nothing_mapped(tracks, len(mapping.tracked.detections)))


def save_refused_views(result: Localization, run: RunDirectory, outlet: Outlet) -> None:
    """Write every detection that did not help to place the camera; a note tells if those are most."""
    views = [
        {"frame": d.frame, "detection_id": d.id, "category": d.category, "reason": code(result.refused[d.id])}
        for d in result.detections.detections
        if d.id in result.refused
    ]
    run.save(LEFT_OUT, _json("views", views))
    used, total = int(result.figures["views_used"]), len(result.detections.detections)
    if not used or 2 * len(views) > total:
        outlet.note(most_refused(views, used, total))


def nothing_mapped(tracks: Sequence[dict[str, Any]], detections: int) -> str:
    """The note for a map without objects."""
    if not tracks:
        return f"0 objects mapped: {detections} detections make no track: see detections.json"
    return f"0 objects mapped: of {len(tracks)} tracks, {_commonest(tracks)}: see {LEFT_OUT}"


def most_refused(views: Sequence[dict[str, Any]], used: int, total: int) -> str:
    """The note for a path that few views of the map hold."""
    if not total:
        return "0 views used: nothing is detected in any frame: the path is that of odometry alone"
    why = f": of {len(views)} that were not, {_commonest(views)}: see {LEFT_OUT}" if views else ""
    return f"{used} of {total} views used{why}"


def code(reason: str) -> str:
    """A reason as a short stable code."""
    return reason.replace(" ", "_")


def _commonest(rows: Iterable[dict[str, Any]]) -> str:
    """The reason of most, and one row's figures."""
    listed = list(rows)
    [(reason, count)] = Counter(row["reason"] for row in listed).most_common(1)
    detail = next((row["detail"] for row in listed if row["reason"] == reason and row.get("detail")), "")
    return f"{count} are left out as {reason}" + (f" (one: {detail})" if detail else "")


def _json(what: str, rows: Sequence[dict[str, Any]]) -> str:
    """Counts of the reasons, and the rows, one a line."""
    counts = dict(sorted(Counter(row["reason"] for row in rows).items()))
    head = json.dumps({"format": "meshslam-left-out", "version": 1, "reasons": counts}, ensure_ascii=False)
    lines = ",\n".join(json.dumps(row, ensure_ascii=False) for row in rows)
    return f'{head[:-1]}, "{what}": [\n{lines}\n]}}\n'
