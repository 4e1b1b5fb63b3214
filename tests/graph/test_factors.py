import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.geometry import NoiseModel, Pose, exp_so3
from meshslam.graph.object_factor import ObservationCost, place_camera
from meshslam.localization.correction import MapObservation, correct
from meshslam.motion.gtsam_bridge import from_pose3, to_gtsam_covariance, to_pose3
from meshslam.objects import ObjectConfig, category_model
from meshslam.objects.observations import make_view
from tests.fixtures.imu_street import IMU_FROM_CAMERA

RATE = np.array([0.02, -0.05, 0.3])


def turned(rotation_vector):
    """The mounting, turned."""
    return Pose(IMU_FROM_CAMERA.rotation @ exp_so3(rotation_vector), IMU_FROM_CAMERA.translation)


def random_pose(rng, size=1.0):
    return Pose(exp_so3(rng.normal(0, size, 3)), rng.normal(0, size, 3))


def test_bridge_keeps_poses_and_orders(rng):
    pose, step = random_pose(rng), rng.normal(0, 1e-6, 6)
    assert np.allclose(from_pose3(to_pose3(pose)).matrix, pose.matrix)
    theirs = to_pose3(pose).retract(step[[3, 4, 5, 0, 1, 2]])
    assert np.allclose(from_pose3(theirs).matrix, pose.retract(step).matrix, atol=1e-11)
    covariance = np.diag(np.arange(6.0))
    assert np.allclose(np.diag(to_gtsam_covariance(covariance)), [3, 4, 5, 0, 1, 2])
    left = Pose.identity().retract(pose.adjoint() @ step) @ pose
    assert np.allclose(left.matrix, pose.retract(step).matrix, atol=1e-10)


def test_camera_derivatives(rng):
    pose, velocity, offset = random_pose(rng), rng.normal(0, 5, 3), 0.013
    place = place_camera(pose, velocity, IMU_FROM_CAMERA, offset, RATE)

    def difference(make, h=1e-6):
        columns = []
        for sign in (1, -1):
            moved = make(sign * h).pose
            relative = place.pose.inverse() @ moved
            turn = relative.rotation
            small = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
            columns.append(np.concatenate([relative.translation, small]))
        return (columns[0] - columns[1]) / (2 * h)

    for k in range(6):
        step = np.eye(6)[k]
        by_imu = difference(
            lambda h, s=step: place_camera(pose.retract(h * s), velocity, IMU_FROM_CAMERA, offset, RATE)
        )
        assert np.allclose(by_imu, place.by_imu[:, k], atol=1e-6)
    for k in range(3):
        step = np.eye(3)[k]
        by_rotation = difference(lambda h, s=step: place_camera(pose, velocity, turned(h * s), offset, RATE))
        assert np.allclose(by_rotation, place.by_rotation[:, k], atol=1e-6)
        by_velocity = difference(lambda h, s=step: place_camera(pose, velocity + h * s, IMU_FROM_CAMERA, offset, RATE))
        assert np.allclose(by_velocity, place.by_velocity[:, k], atol=1e-6)
    by_offset = difference(lambda h: place_camera(pose, velocity, IMU_FROM_CAMERA, offset + h, RATE))
    assert np.allclose(by_offset, place.by_offset[:, 0], atol=1e-5)


@pytest.fixture(scope="module")
def near(street, seen):
    """A car in the view of one frame: model, view, camera, object."""
    car = max((c for c in street.cars if not c.moves), key=lambda c: sum(d.track_id == c.id for d in seen.detections))
    detection = max((d for d in seen.detections if d.track_id == car.id), key=lambda d: d.bbox[2] * d.bbox[3])
    category = load_category("car")
    model = category_model(category)
    occluder = np.zeros((street.camera.height, street.camera.width), np.uint8)
    order = [category.keypoint_names.index(n) for n in seen.keypoint_names("car")]
    view = make_view(model, street.camera, Pose.identity(), 0.0, detection, occluder, order, ObjectConfig())
    return model, view, street.world_from_camera[detection.frame], car.start


def keypoints_only(model, camera):
    """A view without a border: its cost is smooth."""
    empty = np.zeros((0, 2))
    return model.view(
        camera,
        Pose.identity(),
        origin=(0, 0),
        distance_px=np.ones((4, 4)),
        cut=np.zeros((4, 4), bool),
        hidden=np.zeros((4, 4), bool),
        border=empty,
        border_length_px=np.zeros(0),
        border_own=np.zeros(0, bool),
        keypoint_index=np.arange(6),
        keypoint_pixels=np.array([[300.0, 90], [330, 95], [280, 110], [310, 70], [290, 80], [350, 100]]),
        keypoint_sigma_px=np.full(6, 4.0),
    )


def test_square_root_holds_the_cost_and_its_derivative(near, street):
    model, _, camera, thing = near
    view, relative = keypoints_only(model, street.camera), camera.inverse() @ thing
    z = np.linspace(-0.5, 0.5, model.mode_count)
    exact = NoiseModel(keypoint_position_sigma_m=0.0)  # else sigma follows the depth, which the derivative leaves out
    found = model.square_root(view, exact, relative, z, modes=True)
    assert np.allclose(found.root, np.triu(found.root))
    assert found.cost == pytest.approx(0.5 * np.sum(found.root[:, -1] ** 2))
    gradient = found.root[:, :-1].T @ found.root[:, -1]

    def cost(step):
        return model.square_root(view, exact, relative.retract(step[:6]), z + step[6:], modes=True).cost

    slopes = [(cost(1e-5 * e) - cost(-1e-5 * e)) / 2e-5 for e in np.eye(len(gradient))]
    assert np.allclose(slopes, gradient, atol=1e-3 * np.abs(gradient).max())


def test_a_step_by_the_square_root_lowers_the_true_cost(near):
    model, view, camera, thing = near
    wrong = (camera.inverse() @ thing).retract(np.array([0.4, -0.2, 0.1, 0.0, 0.0, 0.1]))
    before = model.square_root(view, NoiseModel(), wrong)
    step = np.linalg.lstsq(before.root[:, :-1], -before.root[:, -1], rcond=None)[0]
    after = model.square_root(view, NoiseModel(), wrong.retract(step))
    predicted = 0.5 * np.sum((before.root @ np.append(step, 1.0)) ** 2)
    assert after.cost < before.cost
    assert predicted < before.cost


def test_one_view_corrects_the_camera(near, street):
    model, view, camera, thing = near
    wrong = camera.retract(np.array([0.1, -0.05, 0.15, 0.01, -0.01, 0.005]))
    seen = ObservationCost(model, view, NoiseModel(), street.camera.fx)
    loose = np.diag(np.square([0.2] * 3 + [0.02] * 3))
    found = correct(wrong, loose, {1: MapObservation(seen, thing)})
    before = seen.cost_share(wrong.inverse() @ thing)
    assert found.cost_shares[1] < 0.3 * before
