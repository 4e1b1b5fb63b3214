import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import E, T, V, X

from meshslam.errors import GeometryError
from meshslam.features.point_tracks import PointConfig, PointTracks
from meshslam.geometry import Camera, Pose, TrackedPoints, exp_so3
from meshslam.graph.object_factor import CameraMemo
from meshslam.graph.point_factor import point_factor, point_term, square_root
from meshslam.motion.gtsam_bridge import to_pose3
from tests.reference.point_tracks import linearize, triangulate, triangulated

CAMERA = Camera(width=1240, height=370, fx=720.0, fy=720.0, cx=610.0, cy=172.0)
CONFIG = PointConfig()


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def ride(rng, frames=5):
    """Cameras that look along z and come ahead, turning a little."""
    return [Pose(exp_so3(rng.normal(0, 0.01, 3)), np.array([0.05 * k, 0.02 * k, 1.1 * k])) for k in range(frames)]


def scene(rng, cameras, count=40, noise_px=0.0):
    points = np.column_stack([rng.uniform(-8, 8, count), rng.uniform(-3, 1.5, count), rng.uniform(12, 60, count)])
    pixels = np.stack([CAMERA.project(c.inverse().transform(points)) for c in cameras], axis=1)
    return points, pixels + rng.normal(0, noise_px, pixels.shape)


def tracked(pixels, config=CONFIG):
    groups = pixels if isinstance(pixels, list) else [pixels]
    return TrackedPoints(CAMERA, groups, config.sigma_px, config.kernel)


def test_points_are_where_their_rays_meet(rng):
    cameras = ride(rng)
    points, pixels = scene(rng, cameras)
    found, finite = tracked(pixels).points(cameras)
    assert finite.all()
    assert np.allclose(found, points, atol=1e-6)


def test_what_does_not_part_is_at_infinity(rng):
    cameras = ride(rng)
    ray = np.array([[0.1, -0.05, 1.0]])
    pixels = np.stack([CAMERA.project(ray @ c.rotation) for c in cameras], axis=1)
    found, finite = tracked(pixels).points(cameras)
    assert not finite[0]
    assert np.allclose(found[0] / found[0][2], ray[0], atol=1e-6)


def test_the_cost_knows_no_scale_place_or_heading(rng):
    cameras = ride(rng)
    _, pixels = scene(rng, cameras, noise_px=0.7)
    cost = tracked(pixels).cost(cameras)
    moved = Pose(exp_so3(np.array([0.3, -0.8, 0.5])), np.array([10.0, -4.0, 2.0]))
    for scale in (0.3, 1.0, 2.5):
        others = [moved @ Pose(c.rotation, scale * c.translation) for c in cameras]
        assert tracked(pixels).cost(others) == pytest.approx(cost, rel=1e-6)


def test_the_gradient_is_that_of_the_reduced_cost(rng):
    """With weights held, half the squared residual after the point's best place has this gradient."""
    config = PointConfig(kernel=1e6)
    cameras = ride(rng)
    _, pixels = scene(rng, cameras, noise_px=0.5)
    cameras = [c.retract(rng.normal(0, 1e-3, 6)) for c in cameras]
    found = tracked(pixels, config).normal_equations(cameras)
    numeric = np.zeros(len(found.gradient))
    for i in range(len(numeric)):
        costs = []
        for sign in (1, -1):
            step = np.zeros(6)
            step[i % 6] = sign * 1e-6
            moved = [c.retract(step) if k == i // 6 else c for k, c in enumerate(cameras)]
            costs.append(tracked(pixels, config).cost(moved))
        numeric[i] = (costs[0] - costs[1]) / 2e-6
    assert np.allclose(found.gradient, numeric, rtol=2e-2, atol=2e-3 * np.abs(numeric).max())


def test_wild_tracks_hardly_count(rng):
    cameras = ride(rng)
    _, pixels = scene(rng, cameras, noise_px=0.5)
    clean = tracked(pixels).normal_equations(cameras)
    wild = pixels[:4].copy()
    wild[:, 2] += 60.0
    more = tracked(np.concatenate([pixels, wild])).normal_equations(cameras)
    assert np.linalg.norm(more.gradient - clean.gradient) < 0.1 * np.linalg.norm(clean.gradient)


@pytest.mark.parametrize("seed", range(12))
def test_the_core_is_its_slow_twin(seed):
    """Noise, wild corners, points far off, behind and where a camera stands; all lengths at once."""
    rng = np.random.default_rng(seed)
    cameras = ride(rng, frames=7)
    groups = []
    for length in (2, 3, 7):
        _, pixels = scene(rng, cameras[:length], count=15, noise_px=rng.choice([0.0, 0.7, 20.0]))
        pixels[::5] += rng.normal(0, 300.0, pixels[::5].shape)
        groups.append(pixels)
    cameras = [c.retract(rng.normal(0, 0.02, 6)) for c in cameras]
    found, core = tracked(groups).normal_equations(cameras), tracked(groups)
    hessian, gradient, cost, places = np.zeros((42, 42)), np.zeros(42), 0.0, []
    for pixels in groups:
        seen = cameras[: pixels.shape[1]]
        part = linearize(triangulated(pixels, seen, CAMERA, CONFIG), CAMERA, CONFIG)
        width = len(part.gradient)
        hessian[:width, :width] += part.hessian
        gradient[:width] += part.gradient
        cost += part.cost
        places.append(triangulate(pixels, seen, CAMERA))
    points, finite = core.points(cameras)
    assert np.array_equal(finite, np.concatenate([f for _, f in places]))
    assert np.allclose(points, np.concatenate([p for p, _ in places]), rtol=1e-5, atol=1e-6)
    assert found.cost == pytest.approx(cost, rel=1e-7) == core.cost(cameras)
    assert np.allclose(found.hessian, hessian, rtol=1e-5, atol=1e-7 * np.abs(hessian).max())
    assert np.allclose(found.gradient, gradient, rtol=1e-5, atol=1e-7 * np.abs(gradient).max())
    assert np.array_equal(found.hessian, found.hessian.T)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tracks": [np.zeros((3, 1, 2))]}, "length of a track"),
        ({"tracks": [np.zeros((3, 2, 3))]}, "tracks must have shape"),
        ({"tracks": [np.full((3, 2, 2), np.nan)]}, "finite"),
        ({"sigma_px": 0.0}, "sigma of corners"),
        ({"kernel": np.inf}, "kernel of corners"),
    ],
)
def test_what_is_no_track_is_refused(change, message):
    with pytest.raises(GeometryError, match=message):
        TrackedPoints(**({"camera": CAMERA, "tracks": [], "sigma_px": 1.0, "kernel": 2.0} | change))


def test_fewer_cameras_than_tracks_see_and_poses_that_are_no_numbers_are_refused(rng):
    cameras = ride(rng)
    _, pixels = scene(rng, cameras)
    with pytest.raises(GeometryError, match="cameras"):
        tracked(pixels).cost(cameras[:4])
    with pytest.raises(GeometryError, match="finite"):
        tracked(pixels).cost([*cameras[:4], Pose(np.eye(3), np.full(3, np.nan))])
    assert tracked([]).cost([]) == 0.0


def test_square_root_keeps_the_normal_equations_and_the_cost(rng):
    wide = rng.normal(size=(30, 12))
    wide[:, -1] = wide[:, 0]  # one direction that nothing tells
    residual = rng.normal(size=30)
    cost = 0.5 * residual @ residual + 1.0
    rows, right = square_root(wide.T @ wide, wide.T @ residual, cost)
    assert np.allclose(rows.T @ rows, wide.T @ wide)
    assert np.allclose(rows.T @ right, wide.T @ residual)
    assert 0.5 * right @ right == pytest.approx(cost)


def test_the_factor_draws_cameras_back(rng):
    """A graph of one block, two cameras held: the others come back to where they were."""
    cameras = ride(rng)
    _, pixels = scene(rng, cameras)
    keys = {k: (X(k), V(k), E(0), T(0)) for k in range(5)}
    memos = {k: CameraMemo(np.zeros(3), np.zeros(3)) for k in range(5)}
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(point_factor(point_term(PointTracks(0, 0, (pixels,), True, pixels[:, -2:]), keys, memos, CAMERA, CONFIG)))
    tight = gtsam.noiseModel.Isotropic.Sigma(6, 1e-4)
    for k, camera in enumerate(cameras):
        if k < 2:
            graph.add(gtsam.PriorFactorPose3(X(k), to_pose3(camera), tight))
        start = camera if k < 2 else camera.retract(rng.normal(0, 0.01, 6))
        values.insert(X(k), to_pose3(start))
        values.insert(V(k), np.zeros(3))
    values.insert(E(0), gtsam.Rot3())
    values.insert(T(0), np.zeros(1))
    graph.add(gtsam.PriorFactorRot3(E(0), gtsam.Rot3(), gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)))
    graph.add(gtsam.PriorFactorVector(T(0), np.zeros(1), gtsam.noiseModel.Isotropic.Sigma(1, 1e-6)))
    for k in range(5):
        graph.add(gtsam.PriorFactorVector(V(k), np.zeros(3), gtsam.noiseModel.Isotropic.Sigma(3, 1.0)))
    found = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    for k, camera in enumerate(cameras):
        assert np.allclose(found.atPose3(X(k)).matrix(), camera.matrix, atol=5e-3)
