"""A3DP and KITTI's AP over frames, and calibration."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from meshslam.evaluation.a3dp import LOOSE, STRICT, a3dp_figures, criteria, shape_similarity
from meshslam.evaluation.calibration import Calibration, object_calibration, path_calibration
from meshslam.evaluation.kitti_detection import kitti_detection_figures
from meshslam.evaluation.seen import SeenFrame, Sight
from meshslam.geometry import Pose
from meshslam.maps import Trajectory, TrajectoryEstimate

CAMERA = Pose(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([0.0, 0.0, 1.65]))


def sight(thing, score=0.9, height_px=60.0, counts=True, camera=CAMERA):
    return Sight(thing, camera.inverse() @ thing.world_from_object, thing.world_from_object, score, height_px, counts)


def moved(thing, number, shift=(0, 0, 0), yaw=0.0):
    pose = thing.world_from_object
    return replace(
        thing,
        id=number,
        world_from_object=Pose(np.eye(3), np.array(shift, float)) @ pose @ Pose.from_yaw(yaw, np.zeros(3)),
    )


def frame(truths, estimates, scores=None):
    scores = scores or [0.9 - 0.01 * k for k in range(len(estimates))]
    return SeenFrame(0, tuple(map(sight, truths)), tuple(sight(e, s) for e, s in zip(estimates, scores, strict=True)))


def test_criteria_are_the_paper_s():
    shapes, metres, angles = zip(*criteria(relative=False), strict=True)
    np.testing.assert_allclose(shapes, np.arange(0.5, 0.951, 0.05), atol=1e-6)
    np.testing.assert_allclose(metres, np.arange(2.8, 0.09, -0.3), atol=1e-6)
    np.testing.assert_allclose(np.degrees(angles), np.arange(30, 2, -3), atol=1e-6)
    np.testing.assert_allclose([c.translation for c in criteria(relative=True)], np.arange(10, 0, -1) / 100, atol=1e-6)
    assert (LOOSE[True].translation, STRICT[True].translation, STRICT[False].translation) == (0.10, 0.05, 1.4)


def test_perfect_objects_have_one(true_cars):
    seen = [frame(true_cars, [moved(c, 50 + c.id) for c in true_cars])]
    assert set(a3dp_figures(seen).values()) == {1.0}
    assert set(kitti_detection_figures(seen).values()) == {100.0}


def test_a3dp_of_a_shift_by_hand(make_car):
    """1 m off at a distance of 20 m: 2.8, 2.5, … 1.0 m allow it, and 10% to 5%."""
    car = make_car(1, [20.0, 0.0, 1.65])
    found = a3dp_figures([frame([car], [moved(car, 2, (1.0, 0, 0))])])
    assert found["a3dp_abs_mean"] == pytest.approx(7 / 10)
    assert found["a3dp_rel_mean"] == pytest.approx(6 / 10)
    assert (found["a3dp_abs_loose"], found["a3dp_abs_strict"]) == (1.0, 1.0)
    assert (found["a3dp_rel_loose"], found["a3dp_rel_strict"]) == (1.0, 1.0)


def test_a3dp_of_a_turn_by_hand(make_car):
    """10 degrees off: 30, 27, … 12 degrees allow it."""
    car = make_car(1, [20.0, 3.0, 1.0])
    found = a3dp_figures([frame([car], [moved(car, 2, yaw=np.radians(10))])])
    assert found["a3dp_abs_mean"] == pytest.approx(7 / 10)
    assert found["a3dp_abs_strict"] == 1.0
    wide = a3dp_figures([frame([car], [moved(car, 2, yaw=np.radians(28))])])
    assert (wide["a3dp_abs_mean"], wide["a3dp_abs_loose"], wide["a3dp_abs_strict"]) == (pytest.approx(0.1), 1.0, 0.0)
    reversed_car = a3dp_figures([frame([car], [moved(car, 2, yaw=np.pi)])])
    assert set(reversed_car.values()) == {0.0}


def test_a3dp_needs_the_shape(make_car):
    """A car half as high: no criterion of shape above its similarity holds."""
    car = make_car(1, [15.0, 2.0, 1.0])
    flat = replace(moved(car, 2), vertices=car.vertices * [1, 1, 0.62])
    alike = shape_similarity(car, flat)
    assert 0.5 < alike < 0.7
    found = a3dp_figures([frame([car], [flat])])
    assert found["a3dp_abs_mean"] == pytest.approx(np.mean([alike >= s for s in np.arange(0.5, 0.951, 0.05)]))
    assert found["a3dp_abs_strict"] == 0.0
    assert shape_similarity(car, car) == 1.0


def test_kitti_ap_of_one_miss_and_one_wrong_by_hand(true_cars):
    """Of two cars the surer answer is right, the other 3 m off: precision 1 up to a recall of 1/2, then 0."""
    one, two = true_cars[:2]
    seen = [frame([one, two], [moved(one, 50), moved(two, 51, (3.0, 3.0, 0))])]
    assert set(kitti_detection_figures(seen).values()) == {50.0}
    seen = [frame([one, two], [moved(one, 50), moved(two, 51, (3.0, 3.0, 0))], [0.5, 0.9])]
    assert set(kitti_detection_figures(seen).values()) == {25.0}


@pytest.mark.parametrize(("iou", "at_70", "at_50"), [(0.72, 100, 100), (0.65, 0, 100), (0.52, 0, 100), (0.48, 0, 0)])
def test_kitti_ap_of_an_overlap_by_hand(make_car, iou, at_70, at_50):
    """Moved ahead by s, a car of length L overlaps by (L - s) / (L + s)."""
    car = make_car(1, [15.0, 3.0, 0.8])
    found = kitti_detection_figures([frame([car], [moved(car, 2, (car.dimensions[0] * (1 - iou) / (1 + iou), 0, 0))])])
    assert (found["kitti_ap_bev_70_percent"], found["kitti_ap_bev_50_percent"]) == (at_70, at_50)
    assert (found["kitti_ap_3d_70_percent"], found["kitti_ap_3d_50_percent"]) == (at_70, at_50)


def test_kitti_ap_tells_plan_from_space(true_cars):
    car = true_cars[0]
    found = kitti_detection_figures([frame([car], [moved(car, 50, (0, 0, 0.6))])])
    assert (found["kitti_ap_bev_70_percent"], found["kitti_ap_3d_70_percent"]) == (100.0, 0.0)


def test_small_boxes_neither_help_nor_harm(true_cars):
    one, two = true_cars[:2]
    small = sight(two, height_px=20.0)
    answer = sight(moved(two, 51, (5.0, 0, 0)), 0.95, height_px=20.0)
    seen = [SeenFrame(0, (sight(one), small), (sight(moved(one, 50)), answer))]
    assert set(kitti_detection_figures(seen).values()) == {100.0}


def test_the_order_of_cars_says_nothing(true_cars, rng):
    estimates = [moved(c, 50 + c.id, rng.normal(0, 0.5, 3), rng.normal(0, 0.1)) for c in true_cars]
    scores = rng.random(len(estimates)).tolist()
    seen = frame(true_cars, estimates, scores)
    order = rng.permutation(len(estimates)).tolist()
    turned = frame(true_cars[::-1], [estimates[k] for k in order], [scores[k] for k in order])
    assert a3dp_figures([seen]) == a3dp_figures([turned])
    assert kitti_detection_figures([seen]) == kitti_detection_figures([turned])


def test_right_covariances_are_calibrated(rng):
    root = rng.normal(0, 1, (6, 6)) * [0.1, 0.1, 0.1, 0.01, 0.01, 0.01]
    covariance = root.T @ root
    truth = [Pose(Rotation.random(random_state=k).as_matrix(), rng.normal(0, 5, 3)) for k in range(4000)]
    errors = rng.multivariate_normal(np.zeros(6), covariance, len(truth))
    estimates = []
    for true, e in zip(truth, errors, strict=True):
        turned = true.rotation @ Rotation.from_rotvec(-e[3:]).as_matrix()
        estimates.append(Pose(turned, true.translation - turned @ e[:3]))
    times_s = 0.1 * np.arange(len(truth))
    path = TrajectoryEstimate(
        Trajectory(times_s, tuple(estimates)),
        tuple(range(len(truth))),
        np.tile(covariance, (len(truth), 1, 1)),
        np.zeros((len(truth), 3)),
        None,
        ("images",) * len(truth),
        np.zeros(len(truth), bool),
    )
    for name, part in path_calibration(Trajectory(times_s, tuple(truth)), path).items():
        found = part.figures(name)
        assert found[f"{name}_nees"] == pytest.approx(1.0, abs=0.05)
        assert found[f"{name}_within_68"] == pytest.approx(0.6827, abs=0.03)
        assert found[f"{name}_within_95"] == pytest.approx(0.95, abs=0.015)


def test_the_first_pose_that_lays_the_world_is_left_out(random_path):
    path = random_path(5)
    covariances = np.tile(0.01 * np.eye(6), (5, 1, 1))
    covariances[0] = 0.0
    estimate = TrajectoryEstimate(
        path, tuple(range(5)), covariances, np.zeros((5, 3)), None, ("imu",) * 5, np.zeros(5, bool)
    )
    assert len(path_calibration(path, estimate)["camera_pose"].squares) == 4


def test_objects_that_are_too_sure_are_told(true_cars):
    shifted = [replace(moved(c, 50 + c.id, (0.3, 0, 0)), pose_covariance=1e-4 * np.eye(6)) for c in true_cars]
    found = object_calibration(list(zip(true_cars, shifted, strict=True)))
    assert found.figures("object_position") == {
        "object_position_within_68": 0.0,
        "object_position_within_95": 0.0,
        "object_position_nees": pytest.approx(0.09 / 1e-4 / 3),
    }
    assert Calibration(np.zeros(0), 3).figures("x") == {}
