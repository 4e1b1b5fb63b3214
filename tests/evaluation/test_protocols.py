"""Every protocol over a case with all truth, and what is said where a part is missing."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from meshslam.errors import ConfigError, MeshslamError
from meshslam.evaluation import FORMATS, PROTOCOLS, Options, evaluate_run, formatted, measure
from meshslam.geometry import Pose
from meshslam.maps import Map, Trajectory
from meshslam.perception import read_detections, write_detections
from meshslam.runs import Measurable, read_material
from tests.evaluation.conftest import moved

PERFECT = {
    "voxel_iou_mean": 1.0,
    "f_score_5cm_mean": 1.0,
    "recall": 1.0,
    "mota": 1.0,
    "idf1": 1.0,
    "hota": 1.0,
    "a3dp_abs_mean": 1.0,
    "a3dp_rel_mean": 1.0,
    "kitti_ap_3d_70_percent": 100.0,
}


@pytest.fixture
def case_and_run(write_truth, write_masks, true_cars):
    """A drive along a straight path; the run's path, detections and objects are the true ones."""
    run = write_masks(true_cars, true_cars)
    path = Trajectory.load(run / "trajectory.tum")
    case = write_truth(true_cars, path=path)
    found = read_detections(run / "detections.json")
    (case / "detections.json").write_bytes((run / "detections.json").read_bytes())
    (case / "association.json").write_text(json.dumps({str(d.id): d.track_id for d in found.detections}))
    return case, run


def figures(case, run, names=(), options=None, **given):
    material, _ = read_material(Measurable(run, truth=case, **given), options)
    rows = measure(material, names)
    return {k: v for row in rows for k, v in row.figures.items()}, {r.protocol: r.reason for r in rows if r.reason}


def test_a_perfect_run_is_perfect(case_and_run):
    found, left = figures(*case_and_run)
    for key, value in PERFECT.items():
        assert found[key] == pytest.approx(value, abs=1e-6), key
    zero = ("_rmse_m", "_mean_m", "_max_m", "_median_m", "_rmse_deg", "end_error_percent", "objects_extra")
    for key in (key for key in found if key.endswith(zero)):
        assert found[key] == pytest.approx(0.0, abs=1e-5), key
    assert set(left) == {"kitti-odometry", "rpe-metres", "calibration-objects", "calibration-path"}
    assert "1.4 m long" in left["kitti-odometry"]
    assert "trajectory.csv" in left["calibration-path"]


def test_figures_of_metrics_json_are_the_same(case_and_run, true_cars, rng):
    case, run = case_and_run
    Map(tuple(moved(c, c.id, rng.normal(0, 0.2, 3), 0.05, 1.05) for c in true_cars)).save(run)
    path = Trajectory.load(run / "trajectory.tum")
    off = tuple(Pose(p.rotation, p.translation + rng.normal(0, 0.1, 3)) for p in path.world_from_camera)
    Trajectory(path.times_s, off).save(run / "trajectory.tum")
    found, _ = figures(case, run)
    public = evaluate_run(case, run)
    assert len(public) == 7
    for key, value in public.items():
        assert found[key] == value, key


def test_renumbering_the_cars_changes_nothing(case_and_run, true_cars, rng):
    case, run = case_and_run
    estimates = [moved(c, c.id, rng.normal(0, 0.3, 3), rng.normal(0, 0.2)) for c in true_cars]
    Map(tuple(estimates)).save(run)
    before, _ = figures(case, run)
    numbers = dict(zip([c.id for c in true_cars], rng.permutation(len(true_cars)).tolist(), strict=True))
    Map(tuple(replace(e, id=100 + numbers[e.id]) for e in estimates)).save(run)
    found = read_detections(run / "detections.json")
    tracks = {d.id: 100 + numbers[d.track_id] for d in found.detections}
    (run / "detections.json").write_bytes(write_detections(found.with_tracks(tracks)))
    after, _ = figures(case, run)
    assert after == pytest.approx(before)


def test_alignment_undoes_another_world(case_and_run, true_cars):
    case, run = case_and_run
    before, _ = figures(case, run)
    world = Pose.from_yaw(2.0, np.array([30.0, -5.0, 2.0]))
    path = Trajectory.load(run / "trajectory.tum")
    Trajectory(path.times_s, tuple(world @ p for p in path.world_from_camera)).save(run / "trajectory.tum")
    Map(tuple(replace(c, world_from_object=world @ c.world_from_object) for c in true_cars)).save(run)
    material, _ = read_material(Measurable(run, truth=case))
    lost = {k: v for row in measure(material) for k, v in row.figures.items()}
    assert lost["recall"] == 0.0
    assert lost["a3dp_abs_mean"] == lost["kitti_ap_3d_70_percent"] / 100 == 1.0  # they are taken from the camera
    found = {k: v for row in measure(material.aligned()) for k, v in row.figures.items()}
    assert found == pytest.approx(before, abs=1e-5)


@pytest.mark.parametrize(
    ("gone", "protocols", "said"),
    [
        ("run/map.json", {"voxel-iou", "centre-yaw", "chamfer", "f-score", "a3dp", "kitti-ap", "mask-iou"}, "no map"),
        ("run/detections.json", {"a3dp", "kitti-ap", "mota", "idf1", "hota", "mask-iou"}, "no detections.json"),
        ("run/camera.yaml", {"mask-iou"}, "camera.yaml"),
        ("case/association.json", {"a3dp", "kitti-ap", "mota", "idf1", "hota"}, "no association.json"),
        ("case/detections.json", {"a3dp", "kitti-ap", "mota", "idf1", "hota"}, "no detections.json"),
        ("case/objects.json", {"voxel-iou", "centre-yaw", "chamfer", "f-score", "a3dp", "kitti-ap"}, "no objects.json"),
        ("case/groundtruth.tum", {"ate", "ate-se3", "ate-sim3", "rpe-frames", "a3dp", "kitti-ap"}, "no groundtruth"),
    ],
)
def test_what_is_missing_is_the_reason(case_and_run, gone, protocols, said):
    case, run = case_and_run
    folder, _, name = gone.partition("/")
    ({"run": run, "case": case}[folder] / name).unlink()
    _, left = figures(case, run)
    assert protocols <= set(left)
    assert all(said in left[name] for name in protocols), left


def test_other_clocks_are_told_with_their_times(case_and_run):
    case, run = case_and_run
    path = Trajectory.load(run / "trajectory.tum")
    Trajectory(path.times_s + 0.02, path.world_from_camera).save(run / "trajectory.tum")
    _, left = figures(case, run, ["ate"])
    assert "0.020 to 0.220 s" in left["ate"]
    assert "--max-difference" in left["ate"]
    found, left = figures(case, run, ["ate"], Options(max_difference_s=0.03))
    assert (found["ate_rmse_m"], left) == (pytest.approx(0, abs=1e-9), {})


def test_a_part_of_a_recording_is_said(case_and_run):
    case, run = case_and_run
    found = read_detections(run / "detections.json")
    part = replace(found, images=found.images[:2], detections=tuple(d for d in found.detections if d.frame < 2))
    (run / "detections.json").write_bytes(write_detections(part))
    path = Trajectory.load(run / "trajectory.tum")
    Trajectory(path.times_s[:2], path.world_from_camera[:2]).save(run / "trajectory.tum")
    material, notes = read_material(Measurable(run, truth=case))
    assert any("the run has 2 of the recording's 3 frames" in note for note in notes)
    found = {key: value for row in measure(material, ["tracks", "a3dp"]) for key, value in row.figures.items()}
    assert found["mota"] == found["hota"] == found["a3dp_abs_mean"] == 1.0


def test_only_what_is_chosen_is_measured(case_and_run):
    found, left = figures(*case_and_run, ["ate", "tracks"])
    assert {key.partition("_")[0] for key in found} == {"ate", "end", "mota", "idf1", "hota"}
    assert not left
    with pytest.raises(ConfigError, match="--protocol speed: there is no such protocol or group: choose of ate, "):
        figures(*case_and_run, ["speed"])


def test_paths_of_other_programs(tmp_path, random_path):
    """TUM against TUM, EuRoC and KITTI; KITTI's lines need times, or another of as many lines."""
    path = random_path(30)
    path.save(tmp_path / "estimate.tum")
    rows = []
    for time_s, pose in zip(path.times_s, path.world_from_camera, strict=True):
        numbers = [*pose.translation, *pose.to_quaternion(order="wxyz"), 0.0, 0.0]
        rows.append(f"{round(1e9 * (time_s + 1000)):d}," + ",".join(f"{v:.9f}" for v in numbers))
    (tmp_path / "data.csv").write_text("#timestamp [ns],p_x\n" + "\n".join(rows) + "\n")
    Trajectory(path.times_s + 1000, path.world_from_camera).save(tmp_path / "late.tum")
    kitti = "".join(" ".join(f"{v:.12f}" for v in p.matrix[:3].ravel()) + "\n" for p in path.world_from_camera)
    (tmp_path / "06.txt").write_text(kitti)
    (tmp_path / "times.txt").write_text("".join(f"{t:.6f}\n" for t in path.times_s))

    def ate(estimate, truth, times=None):
        given = Measurable(None, tmp_path / estimate, tmp_path / truth, None if times is None else tmp_path / times)
        material, _ = read_material(given)
        return {k: v for row in measure(material, ["ate-se3"]) for k, v in row.figures.items()}["ate_se3_rmse_m"]

    assert ate("late.tum", "data.csv") < 1e-6
    assert ate("06.txt", "06.txt") < 1e-9
    assert ate("estimate.tum", "06.txt", "times.txt") < 1e-6
    with pytest.raises(MeshslamError, match=re.escape("06.txt: KITTI's poses have no times: give --times FILE")):
        ate("estimate.tum", "06.txt")
    (tmp_path / "short.txt").write_text("".join(kitti.splitlines(keepends=True)[:20]))
    with pytest.raises(MeshslamError, match=r"20 poses, but .* has 30: without times they are paired line by line"):
        ate("short.txt", "06.txt")


def test_formats_hold_every_figure(case_and_run):
    material, notes = read_material(Measurable(case_and_run[1], truth=case_and_run[0]))
    rows = measure(material)
    texts = {suffix: formatted(suffix, rows, {"notes": list(notes)}) for suffix in FORMATS}
    keys = [key for row in rows for key in row.figures]
    assert len(keys) == len(set(keys)) > 30
    assert set(json.loads(texts[".json"])["figures"]) == set(keys)
    for key in keys:
        assert key in texts[".csv"]
        assert key in texts[".md"]
        assert key.replace("_", r"\_") in texts[".tex"]
    for row in rows:
        assert row.reason is None or all(row.protocol in text for text in texts.values())
    lines = texts[".csv"].splitlines()
    assert lines[0] == "protocol,group,figure,value,better,not_computed"


def test_every_protocol_says_its_source():
    assert all(p.source and p.title for p in PROTOCOLS.values())
    assert {p.group for p in PROTOCOLS.values()} == {"trajectory", "objects", "tracks", "calibration", "masks"}


def test_an_object_is_seen_once_a_frame_by_its_surest_detection(case_and_run):
    case, run = case_and_run
    found = read_detections(run / "detections.json")
    again = tuple(replace(d, id=d.id + 1000, score=0.1 if d.id % 2 else 0.97) for d in found.detections)
    (run / "detections.json").write_bytes(write_detections(replace(found, detections=(*found.detections, *again))))
    material, _ = read_material(Measurable(run, truth=case))
    for seen in material.seen():
        ids = [e.thing.id for e in seen.estimates]
        assert ids == sorted(set(ids)) == [t.thing.id for t in seen.truths]
        assert all(e.score in (0.9, 0.97) for e in seen.estimates)
    assert figures(case, run, ["kitti-ap"])[0]["kitti_ap_3d_70_percent"] == 100.0
