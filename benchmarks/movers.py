"""Cars that drive: positions, speeds, meshes against the truth, and whether parked cars are called moving.

    OMP_NUM_THREADS=1 .venv/bin/python benchmarks/movers.py [--only labelled] [--seeds 3] [--json FILE]

Every case is made, mapped and scored here: figures are medians over a car's poses, then over the cars. A car that
drives counts if it is seen at least 36 px wide in 8 frames, nearer than 40 m, and goes 3 m meanwhile.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from movers_cases import drawn_street, labelled_street
from scipy.optimize import linear_sum_assignment

import meshslam
from meshslam.geometry import Pose, voxel_iou
from meshslam.maps import Map, MovingObject, MovingPath

LABELLED = (
    ("0000", 0, 100),
    ("0001", 330, 100),
    ("0005", 150, 110),
    ("0011", 120, 110),
    ("0011", 215, 110),
    ("0020", 0, 90),
    ("0020", 200, 90),
    ("0020", 355, 90),
    ("0020", 600, 90),
)
WIDE_PX, SEEN, WITHIN_M, GOES_M = 36.0, 8, 40.0, 3.0
MATCH_M = 3.0
LIMITS_3 = 3.527, 7.815  # 68 and 95% of a squared Mahalanobis distance over three axes


@dataclass
class Score:
    """What one case, or all of them, came to."""

    rows: list[dict[str, Any]] = field(default_factory=list)
    parked: int = 0
    called_moving: int = 0  # parked cars among the moving objects
    left_out_as_moving: int = 0  # parked cars that are left out as such
    fragments: int = 0  # moving objects of further tracks of cars that drive

    def add(self, other: Score) -> None:
        self.rows += other.rows
        self.parked += other.parked
        self.called_moving += other.called_moving
        self.left_out_as_moving += other.left_out_as_moving
        self.fragments += other.fragments

    def summary(self) -> dict[str, float]:
        counted = [row for row in self.rows if row["counts"]]
        found = [row for row in counted if "position_m" in row]
        figures = {"cars": len(counted), "found": len(found) / max(1, len(counted))}
        for name in (
            "position_m",
            "speed_m_s",
            "iou",
            "iou_placed",
            "heading_deg",
            "within_68",
            "within_95",
            "speed_z",
        ):
            figures[name] = float(np.median([row[name] for row in found])) if found else float("nan")
        for name in ("within_68", "within_95"):
            figures[name] = float(np.mean([row[name] for row in found])) if found else float("nan")
        figures["position_p90_m"] = float(np.quantile([row["position_m"] for row in found], 0.9)) if found else np.nan
        counts = (self.parked, self.called_moving, self.left_out_as_moving, self.fragments)
        return figures | dict(zip(("parked", "called_moving", "left_out_as_moving", "fragments"), counts, strict=True))


def score(case: Path) -> Score:
    """Map a case and compare."""
    result = meshslam.map_drive(case)
    truth, parked = Map.load(case / "moving.json").moving, json.loads((case / "objects.json").read_text())["objects"]
    association = {int(k): v for k, v in json.loads((case / "association.json").read_text()).items()}
    widths: dict[int, list[tuple[int, float]]] = {}
    shows: dict[int, list[int]] = {}
    for d in result.detections.detections:
        widths.setdefault(association[d.id], []).append((d.frame, d.bbox[2]))
        if d.track_id is not None:
            shows.setdefault(d.track_id, []).append(association[d.id])
    of_track = {track: max(set(seen), key=seen.count) for track, seen in shows.items()}
    seen_parked = {one["id"] for one in parked if sum(w >= WIDE_PX for _, w in widths.get(one["id"], [])) >= 5}
    out = Score(parked=len(seen_parked))
    out.left_out_as_moving = len(
        {of_track[r.track] for r in result.left_out if r.reason == "moves" and r.track in of_track} & seen_parked
    )
    pairs = matched(truth, result.map.moving)
    reasons = {r.track: f"{r.reason}: {r.detail}" for r in result.left_out}
    path = dict(enumerate(result.trajectory.world_from_camera))
    for one in truth:
        row: dict[str, Any] = {"case": case.name, "id": one.id, "counts": counts(one, widths.get(one.id, []), path)}
        row["cars"] = len(one.path)
        if one.id in pairs:
            row |= compared(one, pairs[one.id])
        else:
            row["why"] = [reasons.get(t, "in the map") for t, car in of_track.items() if car == one.id]
        out.rows.append(row)
    for one in result.map.moving:
        if one.id not in {found.id for found in pairs.values()}:
            shown = of_track.get(one.id)
            is_parked = shown in {p["id"] for p in parked}
            out.called_moving += is_parked
            out.fragments += not is_parked
            print(
                "   no car that drives:",
                one.id,
                "parked" if is_parked else of_track.get(one.id),
                f"{one.path.mean_speed_m_s:.1f} m/s",
            )
    return out


def counts(car: MovingObject, seen: list[tuple[int, float]], camera: dict[int, Pose]) -> bool:
    """Whether enough of a car is seen."""
    at = dict(zip(car.path.frame_ids, car.path.positions_in_world, strict=True))
    wide = [frame for frame, width in seen if width >= WIDE_PX and frame in at]
    near = [frame for frame in wide if np.linalg.norm(at[frame] - camera[frame].translation) < WITHIN_M]
    return len(near) >= SEEN and float(np.linalg.norm(at[near[-1]] - at[near[0]])) >= GOES_M


def matched(truth: tuple[MovingObject, ...], found: tuple[MovingObject, ...]) -> dict[int, MovingObject]:
    """The moving object of each true one, by the mean distance at the times that both have."""
    cost = np.full((len(truth), len(found)), 1e6)
    for i, one in enumerate(truth):
        for j, other in enumerate(found):
            a, b = common(one.path, other.path)
            if len(a):
                away = one.path.positions_in_world[a] - other.path.positions_in_world[b]
                cost[i, j] = float(np.median(np.linalg.norm(away, axis=1))) - 1e-3 * len(a)
    rows, columns = linear_sum_assignment(cost)
    return {truth[i].id: found[j] for i, j in zip(rows, columns, strict=True) if cost[i, j] < MATCH_M}


def common(one: MovingPath, other: MovingPath) -> tuple[list[int], list[int]]:
    """Rows of both paths at the same frames."""
    at = {frame: i for i, frame in enumerate(other.frame_ids)}
    rows = [(i, at[frame]) for i, frame in enumerate(one.frame_ids) if frame in at]
    return [i for i, _ in rows], [j for _, j in rows]


def compared(true: MovingObject, found: MovingObject) -> dict[str, float]:
    """Errors of one car's path and mesh; the mesh is compared in the object's frame, and where it was placed."""
    a, b = common(true.path, found.path)
    pairs = [(true.path.world_from_object[i], found.path.world_from_object[j]) for i, j in zip(a, b, strict=True)]
    gaps = np.array([p.rotation.T @ (t.translation - p.translation) for t, p in pairs])
    sigmas = found.path.covariances[b][:, :3, :3] + 1e-9 * np.eye(3)
    squared = np.einsum("ni,ni->n", gaps, np.linalg.solve(sigmas, gaps[..., None])[..., 0])
    speeds = found.path.speeds_m_s[b] - true.path.speeds_m_s[a]
    turned = [np.degrees((t.inverse() @ p).yaw_rad) for t, p in pairs]
    best = b.index(min(b, key=lambda j: abs(found.path.times_s[j] - found.body_time_s)))
    placed = (pairs[best][0].inverse() @ pairs[best][1]).transform(found.vertices)
    return {
        "n": len(a),
        "position_m": float(np.median(np.linalg.norm(gaps, axis=1))),
        "speed_m_s": float(np.median(np.abs(speeds))),
        "true_speed_m_s": float(np.median(true.path.speeds_m_s[a])),
        "heading_deg": float(np.median(np.abs(turned))),
        "iou": voxel_iou(true.vertices, true.faces, found.vertices, found.faces),
        "iou_placed": voxel_iou(true.vertices, true.faces, placed, found.faces),
        "sigma_m": float(np.median(found.path.position_sigmas_m[b])),
        "size_m": (np.ptp(found.vertices, axis=0) - np.ptp(true.vertices, axis=0)).round(2).tolist(),
        "within_68": float((squared <= LIMITS_3[0]).mean()),
        "within_95": float((squared <= LIMITS_3[1]).mean()),
        "speed_z": float(np.median(np.abs(speeds) / found.path.speed_sigmas_m_s[b])),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=("labelled", "drawn"))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--cases", help="part of the names of the cases to run")
    parser.add_argument("--json", type=Path)
    a = parser.parse_args()
    total = {"labelled": Score(), "drawn": Score()}
    with tempfile.TemporaryDirectory() as scratch:
        cases = [
            ("drawn", f"drawn-{seed}", lambda out, seed=seed: drawn_street(out, seed, 40)) for seed in range(a.seeds)
        ]
        cases += [
            ("labelled", f"{sequence}-{start}", lambda out, s=(sequence, start, frames): labelled_street(out, *s, 0))
            for sequence, start, frames in LABELLED
        ]
        for kind, name, make in cases:
            if a.only in (None, kind) and (a.cases is None or a.cases in name):
                make(Path(scratch) / name)
                found = score(Path(scratch) / name)
                total[kind].add(found)
                show(name, found)
                for row in found.rows:
                    if row["counts"]:
                        print(
                            "  ",
                            {
                                k: round(v, 2) if isinstance(v, float) else v
                                for k, v in row.items()
                                if k not in ("case", "counts")
                            },
                        )
    for kind, one in total.items():
        if one.rows:
            show(kind, one)
    if a.json:
        a.json.write_text(
            json.dumps({kind: {"summary": one.summary(), "cars": one.rows} for kind, one in total.items()}, indent=1)
        )


def show(name: str, found: Score) -> None:
    print(f"{name:12}", " ".join(f"{key} {value:.3g}" for key, value in found.summary().items()), flush=True)


if __name__ == "__main__":
    main()
