"""What the three commands tell a log while they compute; and that the log changes nothing."""

import numpy as np
import pytest

import meshslam
from meshslam.categories import load_category
from meshslam.maps import Map, Trajectory
from meshslam.runs import Config, InputConfig, Outlet, overlaid, run_localize, run_map, run_slam
from meshslam.simulation import EXACT, StreetConfig, make_street, write_recording

STREET = StreetConfig(frames=8, width_px=320, height_px=100, focal_px=190.0, cars_each_side=1, speed_m_s=12.0)
QUICK = {"keypoints": {"enabled": False}, "slam": {"poses": "odometry", "min_baseline_m": 1.0}}
FILES = ("map.json", "trajectory.tum", "detections.json", "config.yaml")


class Told:
    """A log that notes what it is told."""

    def __init__(self, colouring="id"):
        self.colouring, self.begun, self.frames, self.live, self.results = colouring, [], [], [], []

    def begin(self, title, camera):
        self.begun.append((title, camera))

    def frame(self, number, time_s, pose=None, covariance=None, image=None, detections=(), objects=None, timings=None):
        shown = image() if callable(image) else image
        self.frames.append((number, time_s, pose, covariance, shown, detections, timings, bool(self.results)))
        if objects is not None:
            self.objects(objects)

    def objects(self, objects):
        self.live.append(tuple(objects))

    def result(self, *given):
        self.results.append(given)

    def close(self):
        raise AssertionError("whoever opened the log closes it")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Each command with and without a log: what the log was told, and the folders."""
    root = tmp_path_factory.mktemp("logged")
    drive = write_recording(make_street(load_category("car"), 3, STREET), root / "drive", EXACT)
    found = {}
    for name, run in (("map", run_map), ("localize", run_localize), ("slam", run_slam)):
        scene = {"map": str(root / "map")} if name == "localize" else {}
        settings = overlaid(Config(InputConfig(sequence=str(drive), **scene)), QUICK, "test")
        told = Told("sigma" if name == "slam" else "id")
        run(settings, root / name, Outlet(), overwrite=False)
        run(settings, root / f"{name}_logged", Outlet(log=told), overwrite=False)
        found[name] = told, settings, run
    return root, found


COMMANDS = pytest.mark.parametrize("name", ["map", "localize", "slam"])


@COMMANDS
def test_a_log_changes_no_result(runs, name):
    root, _ = runs
    for file in FILES:
        plain = root / name / file
        assert plain.exists() or (name, file) == ("localize", "map.json")
        assert not plain.exists() or plain.read_bytes() == (root / f"{name}_logged" / file).read_bytes()


@COMMANDS
def test_every_frame_is_told_as_it_comes_and_as_the_run_ends(runs, name):
    root, found = runs
    told = found[name][0]
    path = Trajectory.load(root / name / "trajectory.tum")
    live = [row for row in told.frames if not row[-1]]
    final = [row for row in told.frames if row[-1]]
    assert len(told.begun) == len(told.results) == 1
    for rows in (live, final):
        assert [row[0] for row in rows] == list(range(STREET.frames))
        np.testing.assert_allclose([row[1] for row in rows], path.times_s, atol=1e-6)
        assert all(row[4].shape == (STREET.height_px, STREET.width_px, 3) for row in rows)
    for row, pose in zip(final, path.world_from_camera, strict=True):
        np.testing.assert_allclose(row[2].matrix, pose.matrix, atol=1e-6)
        assert (row[3] is None) == (name == "map")
    assert all(row[2] is not None for row in live if name != "slam" or row[0] > STREET.frames // 2)
    assert all(set(row[6] or {}) <= {"perception", "localization", "slam"} for row in live)
    assert name == "map" or all(row[6] and min(row[6].values()) > 0 for row in live)


@COMMANDS
def test_objects_are_told_before_the_end_and_the_result_is_the_map(runs, name):
    root, found = runs
    told = found[name][0]
    scene = Map.load(root / ("map" if name == "localize" else name))
    assert {thing.id for thing in told.live[-1]} >= set(scene) if name != "slam" else told.live[-1]
    [(result, numbers, times_s, poses, *_)] = told.results
    assert set(result) == set(scene)
    assert len(numbers) == len(times_s) == len(poses) == STREET.frames
    if name == "slam":
        assert all(thing.pose_covariance is not None for objects in told.live for thing in objects)
    if name == "map":  # they appear one by one
        assert [len(objects) for objects in told.live][:2] == [1, 2]
    tracks = {d.track_id for row in told.frames if row[-1] for d in row[5]}
    assert set(scene) & tracks


@COMMANDS
def test_a_run_that_is_there_is_told_from_its_folder(runs, name):
    root, found = runs
    first, settings, run = found[name]
    again = Told()
    run(settings, root / name, Outlet(log=again), overwrite=False)
    ended = [row for row in first.frames if row[-1]]
    assert [row[0] for row in again.frames] == [row[0] for row in ended]
    for one, other in zip(again.frames, ended, strict=True):
        np.testing.assert_allclose(one[2].matrix, other[2].matrix, atol=1e-6)
        assert [d.track_id for d in one[5]] == [d.track_id for d in other[5]]
        assert (one[3] is None) == (other[3] is None)
    assert set(again.results[0][0]) == set(first.results[0][0])


def test_live_slam_tells_every_frame_and_its_result(runs):
    root, found = runs
    settings = overlaid(found["slam"][1], {"slam": {"poses": "none"}, "live": {"enabled": True}}, "test")
    told = Told()
    run_slam(settings, root / "live", Outlet(log=told), overwrite=False)
    live = [row for row in told.frames if not row[-1]]
    assert [row[0] for row in live] == list(range(STREET.frames))
    assert all(row[4] is not None and row[6]["latency"] >= 0 for row in live)
    [(result, numbers, _, poses, *_)] = told.results
    path = Trajectory.load(root / "live" / "trajectory.tum")
    assert set(result) == set(Map.load(root / "live"))
    assert [row[0] for row in told.frames if row[-1]] == list(numbers)
    np.testing.assert_allclose(
        [p.translation for p in poses], [p.translation for p in path.world_from_camera], atol=1e-6
    )


def test_a_program_gives_its_log_to_the_front_door(runs):
    root, found = runs
    told = Told()
    result = meshslam.map_drive(root / "drive", config=found["map"][1], log=told)
    assert [set(given[0]) for given in told.results] == [set(result.map)] == [set(Map.load(root / "map"))]
