"""Path protocols against evo and against slow twins, and the laws that they keep."""

import numpy as np
import pytest
from evo.core import metrics
from evo.core.trajectory import PoseTrajectory3D
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from meshslam.evaluation.kitti_odometry import LENGTHS_M, kitti_odometry_figures, segment_errors
from meshslam.evaluation.path_pairs import PathPair, pair_paths, positions, umeyama
from meshslam.evaluation.trajectories import (
    absolute_errors_m,
    absolute_rotation_errors_rad,
    angles_rad,
    frame_pairs,
    metre_pairs,
    relative_errors,
    root_mean_square,
)
from meshslam.geometry import Pose
from meshslam.maps import Trajectory
from tests.reference.kitti_odometry import slow_segment_errors


def drive(rng, count, step_m=1.0, wander=0.02):
    turns = Rotation.from_rotvec(np.cumsum(rng.normal(0, wander, (count, 3)), axis=0))
    places = np.cumsum(turns.apply([step_m, 0, 0]) + rng.normal(0, 0.05 * step_m, (count, 3)), axis=0)
    return tuple(Pose(r, p) for r, p in zip(turns.as_matrix(), places, strict=True))


def disturbed(poses, rng, sigma_m=0.3, sigma_rad=0.02):
    return tuple(
        Pose(p.rotation @ Rotation.from_rotvec(rng.normal(0, sigma_rad, 3)).as_matrix(), p.translation + shift)
        for p, shift in zip(poses, rng.normal(0, sigma_m, (len(poses), 3)), strict=True)
    )


def pair_of(rng, count=60, **kinds):
    truth = drive(rng, count, **kinds)
    world = Pose(Rotation.random(random_state=int(rng.integers(1 << 30))).as_matrix(), rng.normal(0, 50, 3))
    estimate = tuple(Pose(q.rotation, 1.1 * q.translation) for q in disturbed(truth, rng))
    return PathPair(0.1 * np.arange(count), truth, tuple(world @ q for q in estimate))


def for_evo(times_s, poses):
    xyzw = np.array([p.to_quaternion(order="xyzw") for p in poses])
    return PoseTrajectory3D(positions(poses), np.roll(xyzw, 1, axis=1), times_s)


def ape(truth, estimate, relation):
    found = metrics.APE(relation)
    found.process_data((truth, estimate))
    return found.error


@pytest.mark.parametrize("seed", range(5))
def test_absolute_errors_are_those_of_evo(seed):
    pair = pair_of(np.random.default_rng(seed))
    for aligned, with_scale in ((False, False), (True, False), (True, True)):
        truth, estimate = for_evo(pair.times_s, pair.truth), for_evo(pair.times_s, pair.estimate)
        ours = pair.aligned(with_scale=with_scale) if aligned else pair
        if aligned:
            estimate.align(truth, correct_scale=with_scale)
        theirs = ape(truth, estimate, metrics.PoseRelation.translation_part)
        np.testing.assert_allclose(absolute_errors_m(ours), theirs, rtol=0, atol=1e-9)
        turned = ape(truth, estimate, metrics.PoseRelation.rotation_angle_rad)
        np.testing.assert_allclose(absolute_rotation_errors_rad(ours), turned, rtol=0, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("unit", "delta"), [("f", 1), ("f", 7), ("m", 5.0), ("m", 23.0)])
def test_relative_errors_are_those_of_evo(seed, unit, delta):
    pair = pair_of(np.random.default_rng(seed), 80)
    chosen = frame_pairs(len(pair), delta) if unit == "f" else metre_pairs(positions(pair.truth), delta)
    metres, radians = relative_errors(pair, *chosen)
    truth, estimate = for_evo(pair.times_s, pair.truth), for_evo(pair.times_s, pair.estimate)
    for relation, ours in (
        (metrics.PoseRelation.translation_part, metres),
        (metrics.PoseRelation.rotation_angle_rad, radians),
    ):
        rpe = metrics.RPE(
            relation,
            delta,
            {"f": metrics.Unit.frames, "m": metrics.Unit.meters}[unit],
            0.1,
            all_pairs=True,
            pairs_from_reference=True,
        )
        rpe.process_data((truth, estimate))
        assert len(ours) > 10
        np.testing.assert_allclose(ours, rpe.error, rtol=0, atol=1e-9)
        assert root_mean_square(ours) == pytest.approx(rpe.get_statistic(metrics.StatisticsType.rmse), abs=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_kitti_segments_are_those_of_the_slow_twin(seed):
    rng = np.random.default_rng(seed)
    pair = pair_of(rng, 640, step_m=1.4, wander=0.01)
    theirs = np.array(slow_segment_errors([p.matrix for p in pair.truth], [p.matrix for p in pair.estimate]))
    ours = segment_errors(pair)
    assert set(ours.lengths_m) == set(map(float, LENGTHS_M))
    np.testing.assert_allclose(ours.lengths_m, theirs[:, 3])
    np.testing.assert_allclose(ours.translation_per_m, theirs[:, 2], rtol=0, atol=1e-9)
    np.testing.assert_allclose(ours.rotation_rad_per_m, theirs[:, 1], rtol=0, atol=1e-9)
    found = kitti_odometry_figures(pair)
    assert found["kitti_t_rel_percent"] == pytest.approx(100 * theirs[:, 2].mean())
    assert found["kitti_r_rel_deg_per_100m"] == pytest.approx(100 * np.degrees(theirs[:, 1].mean()))


def test_metre_pairs_where_the_camera_stands_still(rng):
    """Against a search over all later poses, the first of those that are as near."""
    steps = np.where(rng.random(200) < 0.4, 0.0, rng.uniform(0.1, 1.5, 200))
    truth = np.column_stack([np.concatenate([[0.0], np.cumsum(steps)]), np.zeros((201, 2))])
    for delta in (0.05, 1.0, 7.3, 500.0):
        expected = []
        for i in range(200):
            away = np.abs(truth[i + 1 :, 0] - truth[i, 0] - delta)
            if away.min() <= 0.1 * delta:
                expected.append((i, i + 1 + int(np.argmin(away))))
        np.testing.assert_array_equal(
            np.transpose(metre_pairs(truth, delta)).reshape(-1, 2), np.reshape(expected, (-1, 2))
        )


def test_kitti_of_a_path_three_percent_too_long_by_hand():
    """Poses 1 m apart on a line: a segment of 100 m ends at the first pose beyond it, 101 m on; 3% of that over 100."""
    truth = tuple(Pose(np.eye(3), np.array([float(i), 0, 0])) for i in range(151))
    long = tuple(Pose(np.eye(3), 1.03 * p.translation) for p in truth)
    found = kitti_odometry_figures(PathPair(0.1 * np.arange(151), truth, long))
    assert found == {
        "kitti_t_rel_percent": pytest.approx(3.03),
        "kitti_r_rel_deg_per_100m": 0.0,
        "kitti_segments": 5,  # from poses 0, 10, ... 40
    }


def test_kitti_of_a_steady_turn_by_hand():
    """The estimate turns 0.01 degrees a metre more: 1.01 degrees over a segment of 101 m."""
    truth = tuple(Pose(np.eye(3), np.array([float(i), 0, 0])) for i in range(151))
    turned = tuple(Pose.from_yaw(np.radians(0.01 * i), p.translation) for i, p in enumerate(truth))
    found = kitti_odometry_figures(PathPair(0.1 * np.arange(151), truth, turned))
    assert found["kitti_r_rel_deg_per_100m"] == pytest.approx(1.01)


def test_a_short_path_has_no_kitti_figures(rng):
    assert kitti_odometry_figures(pair_of(rng, 60)) == {}


@given(seed=st.integers(0, 10_000), scale=st.floats(0.2, 5))
@settings(max_examples=25, deadline=None)
def test_alignment_undoes_a_similarity(seed, scale):
    rng = np.random.default_rng(seed)
    truth = drive(rng, 30)
    turn, shift = Rotation.random(random_state=seed).as_matrix(), rng.normal(0, 20, 3)
    moved = tuple(Pose(turn @ p.rotation, scale * turn @ p.translation + shift) for p in truth)
    pair = PathPair(np.arange(30.0), truth, moved)
    assert absolute_errors_m(pair.aligned(with_scale=True)).max() < 1e-9
    assert absolute_rotation_errors_rad(pair.aligned(with_scale=True)).max() < 1e-7
    assert umeyama(positions(truth), positions(moved), with_scale=True).scale == pytest.approx(1 / scale)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_aligned_errors_do_not_depend_on_the_estimates_world(seed):
    rng = np.random.default_rng(seed)
    pair = pair_of(rng, 40)
    world = Pose(Rotation.random(random_state=seed).as_matrix(), rng.normal(0, 100, 3))
    other = PathPair(pair.times_s, pair.truth, tuple(world @ p for p in pair.estimate))
    for with_scale in (False, True):
        one, two = (absolute_errors_m(p.aligned(with_scale=with_scale)) for p in (pair, other))
        np.testing.assert_allclose(one, two, atol=1e-9)
        assert root_mean_square(one) <= root_mean_square(absolute_errors_m(pair)) + 1e-12
    chosen = frame_pairs(40, 3)
    for one, two in zip(relative_errors(pair, *chosen), relative_errors(other, *chosen), strict=True):
        np.testing.assert_allclose(one, two, atol=1e-9)


def test_a_mirrored_path_is_turned_not_mirrored(rng):
    truth = drive(rng, 40, wander=0.3)
    mirrored = tuple(Pose(p.rotation, p.translation * [1, 1, -1]) for p in truth)
    pair = PathPair(np.arange(40.0), truth, mirrored)
    for with_scale in (False, True):
        theirs = for_evo(pair.times_s, mirrored)
        theirs.align(for_evo(pair.times_s, truth), correct_scale=with_scale)
        found = pair.aligned(with_scale=with_scale)
        np.testing.assert_allclose(positions(found.estimate), theirs.positions_xyz, atol=1e-9)
        assert np.linalg.det(found.estimate[0].rotation) == pytest.approx(1.0)


def test_a_straight_path_is_aligned(rng):
    truth = tuple(Pose(np.eye(3), np.array([float(i), 0, 0])) for i in range(20))
    world = Pose.from_yaw(1.0, np.array([3.0, 4.0, 5.0]))
    pair = PathPair(np.arange(20.0), truth, tuple(world @ p for p in truth)).aligned()
    assert absolute_errors_m(pair).max() < 1e-9


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-7, 0.5, np.pi - 1e-7, np.pi])
def test_angles_are_exact_near_both_ends(angle):
    found = angles_rad(Rotation.from_rotvec([[angle, 0, 0], [0, -angle, 0], [0, 0, angle]]).as_matrix())
    np.testing.assert_allclose(found, angle, rtol=1e-9, atol=1e-15)


def test_poses_are_paired_one_to_one(rng):
    path = Trajectory(0.005 * np.arange(200), drive(rng, 200))
    some = Trajectory(path.times_s[3::10] + 1e-3, path.world_from_camera[3::10])
    late = Trajectory(np.append(some.times_s, 9.0), (*some.world_from_camera, path.world_from_camera[0]))
    pair = pair_paths(path, late)
    assert (len(pair), pair.unmatched_truth, pair.unmatched_estimates) == (20, 180, 1)
    assert pair.truth == pair.estimate
    assert len(pair_paths(path, late, 5e-4)) == 0


def test_pairing_knows_no_order_of_the_two(rng):
    one = Trajectory(np.sort(rng.uniform(0, 3, 40)), drive(rng, 40))
    two = Trajectory(np.sort(rng.uniform(0, 3, 55)), drive(rng, 55))
    forth, back = pair_paths(one, two, 0.02), pair_paths(two, one, 0.02)
    assert (forth.truth, forth.estimate) == (back.estimate, back.truth)
    assert (forth.unmatched_truth, forth.unmatched_estimates) == (back.unmatched_estimates, back.unmatched_truth)
