"""How well shapes are recovered: rings of views of every car model and eight streets, by the independent scorer.

    .venv/bin/python benchmarks/shape.py [--only ring1 other_street …] [--seeds 2] [--config FILE] [--stages] [--record]

Cases are made once under benchmarks/out/cases; needs the shared data ($MESHSLAM_DATA, or ../shared/data).
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh
from results import record
from scipy.spatial import KDTree

from meshslam.categories import load_category
from meshslam.mapping import ObjectMapping
from meshslam.maps import Map, Trajectory
from meshslam.objects import category_model
from meshslam.perception import write_detections
from meshslam.runs import Outlet, map_recording, read_config
from meshslam.sequences import open_sequence

ROOT = Path(__file__).resolve().parent
OUT = ROOT / "out"
DATA = Path(os.environ.get("MESHSLAM_DATA", ROOT.parent.parent / "shared" / "data"))
TOOLS = DATA.parent / "tools"
RINGS = (1, 2, 3, 8)
STREETS = (
    ("0001", 0),
    ("0001", 200),
    ("0005", 100),
    ("0005", 180),
    ("0011", 120),
    ("0011", 220),
    ("0020", 350),
    ("0020", 500),
)
OTHER_STREETS = (  # drive, first frame, seed of the cars and the noise
    ("0000", 0, 1),
    ("0000", 30, 2),
    ("0001", 100, 3),
    ("0001", 320, 4),
    ("0005", 30, 5),
    ("0011", 20, 6),
    ("0011", 253, 7),
    ("0020", 150, 8),
    ("0020", 60, 9),
    ("0001", 0, 10),
    ("0011", 120, 11),
    ("0020", 350, 12),
)
NEAR_M = 1.0  # a car of the map this near to a true one is that one
NORMAL = ((68, 1.0), (95, 1.96))  # percent of a normal distribution within so many sigmas
STREET_GROUPS = ("street_noids", "other_street", "other_street_noids")
SEEN = 8  # detections that a car of a street must have to count


def make_case(name: str, arguments: list[str]) -> Path:
    """Make a case, unless it is there."""
    folder = OUT / "cases" / name
    if not (folder / "objects.json").exists():
        folder.parent.mkdir(parents=True, exist_ok=True)
        subprocess.run([sys.executable, TOOLS / "make_case.py", *arguments, "--cads", DATA / "cars"], check=True)
    return folder


def ring(views: int, seed: int) -> Path:
    """A car from a few views around it; the seed chooses the car."""
    name = f"ring{views}_{seed}"
    return make_case(name, ["ring", str(OUT / "cases" / name), "--views", str(views), "--seed", str(seed)])


def street(drive: str, start: int, seed: int = 0, *, ids: bool = True) -> Path:
    """Parked cars along a KITTI path."""
    name = f"street{'' if ids else '_noids'}_{drive}_{start}" + (f"_{seed}" if seed else "")
    track = DATA / "kitti_tracking" / drive
    where = ["--labels", str(track / "label_02.txt"), "--poses", str(track / "poses.txt")]
    window = ["--start", str(start), "--frames", "120", "--seed", str(seed)] + ([] if ids else ["--no-ids"])
    return make_case(name, ["street", str(OUT / "cases" / name), *where, *window])


def score(case: Path, run: Path, seen: int) -> dict[str, object]:
    """Figures of the independent scorer: of the objects, and IDF1 of their association."""
    command = [sys.executable, TOOLS / "score_run.py", case, run, "--seen", str(seen)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(done.stderr)
    figures = json.loads(done.stdout)
    found: dict[str, object] = figures["objects"] | {"idf1": figures["association"]["idf1"]}
    return found


def map_case(case: Path, config: Path | None) -> tuple[Path, dict[str, Map]]:
    """Run mapping on a case and save what the scorer reads; also the map after each stage."""
    settings = read_config(config)
    made = map_recording(open_sequence(case), settings, Outlet())
    frames, mapping = made.frames, made.mapping
    run = OUT / "runs" / case.name
    run.mkdir(parents=True, exist_ok=True)
    mapping.map.save(run)
    (run / "trajectory.tum").write_bytes(as_bytes(Trajectory(frames.times_s, frames.world_from_camera).to_tum()))
    (run / "detections.json").write_bytes(as_bytes(write_detections(mapping.detections)))
    return run, stage_maps(mapping, settings.input.category)


def stage_maps(mapping: ObjectMapping, category: str) -> dict[str, Map]:
    """The map as it was after each stage."""
    model = category_model(load_category(category))
    names = {"mean mesh": "start", "pose": "posed", "modes": "modes"}

    def at(stage: str) -> Map:
        states = {thing.id: getattr(mapping.stages[thing.id], stage) for thing in mapping.map.objects}
        return Map(
            tuple(
                replace(
                    thing,
                    world_from_object=states[thing.id].world_from_object,
                    vertices=model.vertices(states[thing.id]),
                )
                for thing in mapping.map.objects
            )
        )

    return {name: at(stage) for name, stage in names.items()}


def true_surface(mesh: Path) -> tuple[np.ndarray, KDTree]:
    """Centre of a true mesh's bounding box, and points on its surface a centimetre apart."""
    found = trimesh.load(mesh, force="mesh", process=False)
    points, _ = trimesh.sample.sample_surface(found, 200_000, seed=0)
    return found.bounds.mean(axis=0), KDTree(points)


def vertex_errors(case: Path, found: Map) -> np.ndarray:
    """Distance of each vertex to the true surface over its sigma, both meshes in their own frames."""
    truth = json.loads((case / "objects.json").read_text())["objects"]
    places = np.array([t["world_from_object"] for t in truth])[:, :3, 3]
    ratios = []
    for thing in found.objects:
        away = np.linalg.norm(places - thing.world_from_object.translation, axis=1)
        if away.min() < NEAR_M and thing.vertex_sigma_m is not None:
            centre, surface = true_surface(case / truth[int(away.argmin())]["mesh"])
            ratios.append(surface.query(thing.vertices + centre)[0] / thing.vertex_sigma_m)
    return np.concatenate([np.zeros(0), *ratios])


def as_bytes(text: str | bytes) -> bytes:
    return text.encode() if isinstance(text, str) else text


def one(job: tuple[str, Path, int, Path | None, bool]) -> tuple[str, str, dict[str, dict[str, object]]]:
    """Map and score one case."""
    group, case, seen, config, all_stages = job
    run, of_stage = map_case(case, config)
    rows = {"free form": score(case, run, seen)}
    ratio = vertex_errors(case, Map.load(run))
    rows["free form"] |= {"vertices": len(ratio)} | {
        f"vertices_within_{share}": int((ratio < k).sum()) for share, k in NORMAL
    }
    if all_stages:
        for stage, found in of_stage.items():
            folder = OUT / "runs" / f"{case.name}-{stage.replace(' ', '_')}"
            folder.mkdir(parents=True, exist_ok=True)
            found.save(folder)
            shutil.copy(run / "detections.json", folder)
            rows[stage] = score(case, folder, seen)
    return group, case.name, rows


def pooled(rows: list[dict[str, object]]) -> dict[str, float]:
    """Figures over all cars of several cases."""
    true = sum(r["true"] for r in rows)
    cars = [o for r in rows for o in r["objects"]]
    ious = np.array([o["voxel_iou"] for o in cars] + [0.0] * (true - len(cars)))
    weights = [r["matched"] for r in rows if "centre_within_68" in r]
    inside = [
        float(np.average([r[key] for r in rows if key in r], weights=weights)) if sum(weights) else float("nan")
        for key in ("centre_within_68", "centre_within_95")
    ]
    flips = sum(r["yaw_flipped"] for r in rows)
    return {
        "cars": true,
        "voxel IoU": float(ious.mean()),
        "under 0.5": float((ious < 0.5).mean()),
        "recall": len(cars) / max(1, true),
        "extra": sum(r["extra"] for r in rows),
        "duplicates": sum(r["duplicates"] for r in rows),
        "least IDF1": min(r["idf1"] for r in rows),
        "centre m": float(np.median([o["centre_error_m"] for o in cars])) if cars else float("nan"),
        "flips": flips / max(1, len(cars)),
        "in 68": inside[0],
        "in 95": inside[1],
    } | {
        f"vertices in {share}": sum(r.get(f"vertices_within_{share}", 0) for r in rows)
        / max(1, sum(r.get("vertices", 0) for r in rows))
        for share, _ in NORMAL
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    groups = [f"ring{n}" for n in RINGS] + ["street"]
    parser.add_argument("--only", nargs="+", choices=[*groups, *STREET_GROUPS], default=groups)
    parser.add_argument("--seeds", type=int, default=2, help="cases a car model in a ring")
    parser.add_argument("--cars", type=int, default=24, help="how many car models, evenly chosen")
    parser.add_argument("--config", type=Path)
    parser.add_argument("--stages", action="store_true", help="also score the map after each stage")
    parser.add_argument("--each", action="store_true", help="also print each case")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--record", action="store_true", help="write the figures to docs/results.json")
    a = parser.parse_args()

    os.environ["OMP_NUM_THREADS"] = "1"
    jobs = []
    cars = sorted({round(k * 24 / a.cars) for k in range(a.cars)})
    for group in a.only:
        if group.startswith("ring"):
            for seed in (car + 24 * repeat for repeat in range(a.seeds) for car in cars):
                jobs.append((group, ring(int(group[4:]), seed), 1, a.config, a.stages))
        else:
            chosen = OTHER_STREETS if "other" in group else STREETS
            cases = (street(*where, ids="noids" not in group) for where in chosen)
            jobs += [(group, case, SEEN, a.config, a.stages) for case in cases]
    table: dict[tuple[str, str], list[dict[str, object]]] = defaultdict(list)
    with ProcessPoolExecutor(a.jobs) as pool:
        for group, name, rows in pool.map(one, jobs):
            for stage, row in rows.items():
                table[group, stage].append(row)
                if a.each:
                    print(name, stage, {k: v for k, v in row.items() if k != "objects"}, flush=True)
    figures = {key: pooled(rows) for key, rows in table.items()}
    if a.record:
        for (group, stage), row in figures.items():
            if stage == "free form":
                record(f"shape {group}", f"benchmarks/shape.py --seeds {a.seeds}", row)
    print("| cameras | stage | " + " | ".join(next(iter(figures.values()))) + " |")
    print("| --- " * (2 + len(next(iter(figures.values())))) + "|")
    for (group, stage), row in figures.items():
        print(
            f"| {group} | {stage} | "
            + " | ".join(f"{v:.3f}" if isinstance(v, float) else str(v) for v in row.values())
            + " |"
        )


if __name__ == "__main__":
    main()
