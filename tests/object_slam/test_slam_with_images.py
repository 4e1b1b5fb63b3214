"""SLAM with images, saved in the middle: it goes on here and where it is loaded in the same way.

Detections bring no tracks: the online tracker makes them. Point tracks and the road's displacements are factors.
"""

from collections import Counter

import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.errors import MeshslamError
from meshslam.features import RoadConfig
from meshslam.object_slam import LoopClosureConfig, Slam, SlamConfig
from meshslam.object_slam.archive import unpacked_json
from meshslam.runs import Config
from meshslam.sequences import ImuSamples, InitialState
from meshslam.simulation import (
    ImuNoise,
    ObserverConfig,
    StreetConfig,
    make_street,
    observe,
    render_image,
    simulated_imu,
)
from tests.faults.disturbances import FaultInside, InjectedError
from tests.fixtures.equality import same
from tests.fixtures.imu_street import IMU_FROM_CAMERA, errors_m

ROUNDING = 1e-7  # the last bits of linear algebra vary with memory's alignment
SMALL = StreetConfig(frames=16, width_px=400, height_px=130, focal_px=235.0, cars_each_side=3, moving_cars=0)
ROAD = RoadConfig(chord_m=3.0, step_px=1, min_distance_m=3.0, min_correlation=0.1, min_drop=0.0)  # of small images
QUICK = SlamConfig(
    min_baseline_m=2.0, lag_s=0.8, refine_map=False, road=ROAD, loop_closure=LoopClosureConfig(min_views=4)
)


@pytest.fixture(scope="module")
def street():
    return make_street(load_category("car"), 4, SMALL)


@pytest.fixture(scope="module")
def readings(street):
    noise, rng = ImuNoise(), np.random.default_rng(1)
    return simulated_imu(street.times_s, street.world_from_camera, IMU_FROM_CAMERA, noise, rng)


@pytest.fixture(scope="module")
def items(street, readings):
    """Arguments of `process` for each frame."""
    found, _ = observe(street, ObserverConfig())
    assert all(d.track_id is None for d in found.detections)
    imu, last, out = readings.samples, -np.inf, []
    for index, detections in found.by_frame().items():
        now = float(street.times_s[index])
        new = (imu.times_s > last) & (imu.times_s <= now + 0.011)
        last = float(imu.times_s[new][-1])
        samples = ImuSamples(imu.times_s[new], imu.angular_rate_rad_s[new], imu.specific_force_m_s2[new])
        out.append({"time_s": now, "image": render_image(street, index), "detections": detections, "imu": samples})
    return out


@pytest.fixture(scope="module")
def told(street, readings):
    names = tuple(street.cars[0].keypoints)
    return {
        "imu_from_camera": IMU_FROM_CAMERA,
        "start": InitialState(0.0, street.world_from_camera[0], readings.velocity_in_world),
        "keypoint_names": names,
        "height_above_ground_m": street.camera_height_m,
        "config": Config(slam=QUICK),
    }


def run(slam, items):
    return [slam.process(**item) for item in items]


def cameras(states):
    return np.array([s.world_from_camera.matrix for s in states])


def archive(path):
    with np.load(path) as file:
        return {name: file[name] for name in file.files}


@pytest.fixture(scope="module")
def never(street, told, items):
    """The run that is not saved in the middle."""
    slam = Slam(street.camera, **told)
    return slam, run(slam, items)


@pytest.fixture(scope="module")
def never_saved(street, told, items, tmp_path_factory):
    """What it holds in the end."""
    slam, path = Slam(street.camera, **told), tmp_path_factory.mktemp("never") / "end.npz"
    run(slam, items)
    slam.save(path)
    return archive(path)


@pytest.fixture(scope="module", params=[6, 11])
def two(request, street, told, items, tmp_path_factory):
    """A run that was saved after some frames, the one that was loaded, what came of both then, and where they lie."""
    after, folder = request.param, tmp_path_factory.mktemp("saved")
    first = Slam(street.camera, **told)
    run(first, items[:after])
    first.save(folder / "middle.npz")
    second = Slam.load(folder / "middle.npz", street.camera, **told)
    here, there = run(first, items[after:]), run(second, items[after:])
    first.save(folder / "here.npz")
    second.save(folder / "there.npz")
    return first, second, here, there, folder


def test_the_run_uses_all_that_images_tell(never, items):
    """Else the laws below would be about nothing."""
    slam, states = never
    figures = slam.finish().figures
    assert figures["scale_by_road_displacements"] >= 5
    assert len(slam.landmarks()) >= 4
    assert {mark.track for mark in slam.landmarks()} != {0}
    tags = Counter(type(entry.tag).__name__ for entry in slam._estimator.smoother.window.entries)
    assert tags["PointTag"] >= 2
    assert len(states) == len(items)


def test_poses_and_objects_are_the_same_here_and_there(two):
    _, _, here, there, _ = two
    assert cameras(here) == pytest.approx(cameras(there), abs=ROUNDING)
    assert [s.objects for s in here] == [s.objects for s in there]
    assert [s.loop_closures for s in here] == [s.loop_closures for s in there]


def test_the_path_is_that_of_the_run_that_was_not_saved(two, never):
    first, second, here, there, _ = two
    whole, states = never
    for slam, own in ((first, here), (second, there)):
        assert [s.objects for s in own] == [s.objects for s in states[-len(own) :]]
        assert cameras(own) == pytest.approx(cameras(states[-len(own) :]), abs=ROUNDING)
        assert errors_m(slam.trajectory().world_from_camera, whole.trajectory().world_from_camera).max() < ROUNDING


def test_the_end_is_that_of_the_run_that_was_not_saved(two, never):
    """Factors are the same, not linear ones in their place: 600 frames were 2 m apart with these."""
    whole = never[0].finish()
    for slam in two[:2]:
        found = slam.finish()
        assert errors_m(found.trajectory.world_from_camera, whole.trajectory.world_from_camera).max() < ROUNDING
        assert found.estimate.covariances == pytest.approx(whole.estimate.covariances, rel=1e-4, abs=1e-12)


def test_the_end_leaves_the_run_as_it_was(never, never_saved, tmp_path):
    never[0].finish()  # and its covariances
    never[0].save(tmp_path / "after.npz")
    found = archive(tmp_path / "after.npz")
    for name in ("estimator_view_root", "estimator_view_pose", "estimator_window_x", "estimator_linear_rows"):
        assert found[name] == pytest.approx(never_saved[name], rel=1e-6, abs=1e-6), name


def test_tracks_have_the_same_numbers(two, never):
    first, second, *_ = two
    numbers = [mark.track for mark in never[0].landmarks()]
    assert [mark.track for mark in first.landmarks()] == [mark.track for mark in second.landmarks()] == numbers
    assert sorted(first.map()) == sorted(second.map())


def test_displacements_are_counted_on(two, never):
    counts = [slam.finish().figures["scale_by_road_displacements"] for slam in (*two[:2], never[0])]
    assert counts[0] == counts[1] == counts[2]


def test_what_the_end_gives_is_the_same(two):
    first, second, *_ = two
    one, other = first.finish(), second.finish()
    assert errors_m(one.trajectory.world_from_camera, other.trajectory.world_from_camera).max() < ROUNDING
    assert one.figures == other.figures
    assert [d.track_id for d in one.detections.detections] == [d.track_id for d in other.detections.detections]


def without_rounding(name, values):
    """The array, without the right sides of rows whose derivatives are rounding: elimination mixes them freely."""
    out = values.copy()
    if name == "estimator_linear_rows":
        before = np.lib.stride_tricks.sliding_window_view(np.abs(out), 20)[:-1].max(axis=1)
        out[20 + np.flatnonzero(before < 1e-12)] = 0.0
    if name == "estimator_view_root":  # triangles row by row: the last pivot, its right side, what no step changes
        empty = np.abs(out[:, -3]) < 1e-12
        out[empty, -2:] = np.linalg.norm(out[empty, -2:], axis=1, keepdims=True)
    return out


@pytest.mark.parametrize("where", ["here", "there"])
def test_saved_once_more_the_file_is_that_of_the_run_that_was_not_saved_before(two, never_saved, where):
    found = archive(two[-1] / f"{where}.npz")
    assert found.keys() == never_saved.keys()
    for name in ("own", "estimator_plain"):
        assert same(*(unpacked_json(arrays.pop(name)) for arrays in (found, dict(never_saved))), tolerance=1e-6), name
    for name, values in found.items():
        if values.dtype.kind == "f":
            one, other = without_rounding(name, values), without_rounding(name, never_saved[name])
            assert one == pytest.approx(other, rel=1e-5, abs=1e-5), name
        else:
            assert np.array_equal(values, never_saved[name]), name


@pytest.mark.parametrize("room", ["features_", "perception_", "imu"])
def test_points_images_tracker_and_samples_are_as_if_nothing_had_been_saved(two, never_saved, room):
    """They depend on no pose: byte for byte those of the run that was not saved in the middle."""
    for name in ("here", "there"):
        held = archive(two[-1] / f"{name}.npz")
        own = [key for key in never_saved if key.startswith(room)]
        assert own == [key for key in held if key.startswith(room)]
        assert all(np.array_equal(held[key], never_saved[key]) for key in own)


def test_the_graph_holds_objects_on_the_road_point_tracks_and_displacements(never_saved):
    """Else the law above would be about less."""
    tags = Counter(never_saved["estimator_entries"][:, 2].tolist())
    assert min(tags[kind] for kind in (1, 2, 3)) > 0
    assert never_saved["estimator_points_pixels"].dtype == np.float32
    assert not never_saved["estimator_view_is_frozen"].all()


@pytest.mark.parametrize("what", ["in_view", "moving", "joined", "frame_ids", "times_s", "road"])
def test_what_the_run_knows_is_as_if_nothing_had_been_saved(two, never_saved, what):
    whole = unpacked_json(never_saved["estimator_plain"])[what]
    for name in ("here", "there"):
        assert unpacked_json(archive(two[-1] / f"{name}.npz")["estimator_plain"])[what] == whole


def test_faults_inside_leave_no_trace(street, told, items, never):
    """In images, tracker, point tracks and road, too: frames fail somewhere, and are sent again."""
    slam, rng, states, raised = Slam(street.camera, **told), np.random.default_rng(1), [], 0
    for item in items:
        try:
            with FaultInside(int(np.exp(rng.uniform(2, 8.5)))):
                states.append(slam.process(**item))
        except (MeshslamError, InjectedError):
            raised += 1
            states.append(slam.process(**item))
    assert raised > 5
    assert cameras(states) == pytest.approx(cameras(never[1]), abs=1e-6)
    assert sorted(slam.map()) == sorted(never[0].map())
