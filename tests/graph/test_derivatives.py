"""One battery of laws over every factor of the graph: keys, widths, derivatives, the true cost's gradient.

A new factor is one entry of the table: a function, marked with what it makes, from a generator to a `Case`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, E, O, S, T, V, X, Z

import meshslam.graph
from meshslam.categories import load_category
from meshslam.features import PointConfig, PointTracks
from meshslam.geometry import Camera, NoiseModel, Pose, exp_so3, render
from meshslam.graph.config import StartConfig
from meshslam.graph.displacement_factor import displacement_factor
from meshslam.graph.object_factor import CameraMemo, ObservationCost, object_factor
from meshslam.graph.point_factor import point_factor, point_term
from meshslam.graph.road_factor import road_factor
from meshslam.graph.start_factors import start_pose_factor
from meshslam.graph.terms import Term, WindowFactors
from meshslam.graph.view_terms import ViewTerm, view_factor
from meshslam.graph.window import Window, linear_factor, rows_factor
from meshslam.motion import to_pose3
from meshslam.objects import ObjectConfig, category_model, make_view
from meshslam.perception import Detection, encode_mask

CAMERA = Camera(width=640, height=200, fx=400.0, fy=400.0, cx=319.5, cy=90.0)
LEVEL_FROM_CAMERA = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # the camera looks along x
STEP = 1e-5  # of central differences
SEEDS = range(4)


@dataclass(frozen=True, eq=False)
class Case:
    """A factor at random values."""

    factor: gtsam.NonlinearFactor
    values: gtsam.Values
    widths: dict[int, int]  # of a step of each of the factor's keys, in the factor's order
    true_cost: gtsam.NonlinearFactor | None = None  # the factor whose cost has the gradient, where it is another one
    is_robust: bool = False  # half the squared linear residual is not the cost
    tolerance: float = 1e-6  # of derivatives, in the largest one
    term: Term | None = None  # the same, as many are evaluated at once


TABLE: dict[str, tuple[Callable, Callable]] = {}
REDUCED = {point_factor}  # their residual stands for normal equations: only cost and gradient mean something


def makes(function, name):
    """Enter a case into the table: `function` is the maker of factors that it is about."""

    def enter(case):
        TABLE[name] = function, case
        return case

    return enter


def random_pose(rng):
    """A pose anywhere, turned any way."""
    return Pose(exp_so3(rng.normal(0, 1.5, 3)), rng.normal(0, 30, 3))


def random_mounting(rng):
    """imu_from_camera: the camera looks ahead, turned a little, about a metre off."""
    return Pose(LEVEL_FROM_CAMERA @ exp_so3(rng.normal(0, 0.1, 3)), np.array([1.0, 0.2, 0.7]) + rng.normal(0, 0.3, 3))


def insert_camera(values, frame, world_from_camera, mounting, rng):
    """The variables of a frame; the camera is near where it is wanted: velocity and time offset move it on."""
    values.insert(X(frame), to_pose3(world_from_camera @ mounting.inverse()))
    values.insert(V(frame), world_from_camera.rotation @ rng.normal([0, 0, 8], 1.0))


def insert_mounting(values, mounting, rng):
    values.insert(E(0), gtsam.Rot3.ClosestTo(mounting.rotation))
    values.insert(T(0), rng.choice([-1, 1], 1) * rng.uniform(0.004, 0.02, 1))


# --- objects


CATEGORY = load_category("car")
MODEL = category_model(CATEGORY)


def seen_car(rng, *, border):
    """camera_from_object of a car near its best estimate, its modes, its view; without a border the cost is smooth."""
    heading = Pose.from_yaw(rng.uniform(-np.pi, np.pi), np.zeros(3)).rotation
    turn = LEVEL_FROM_CAMERA.T @ heading @ exp_so3(rng.normal(0, 0.05, 3))
    pose = Pose(turn, np.array([rng.uniform(-2, 2), rng.uniform(0.3, 0.8), rng.uniform(9, 14)]))
    mask = np.asarray(render(CAMERA, [(pose, CATEGORY.vertices, CATEGORY.faces)]).mask, np.uint8)
    pixels = CAMERA.project(pose.transform(CATEGORY.keypoints(CATEGORY.vertices))) + rng.normal(0, 1.5, (12, 2))
    box = tuple(float(x) for x in cv2.boundingRect(mask))
    if not border:
        empty, nothing = np.zeros((0, 2)), np.zeros((4, 4), bool)
        field = {"origin": (0, 0), "distance_px": np.ones((4, 4)), "cut": nothing, "hidden": nothing, "border": empty}
        field |= {"border_length_px": np.zeros(0), "border_own": np.zeros(0, bool)}
        points = {"keypoint_index": np.arange(12), "keypoint_pixels": pixels, "keypoint_sigma_px": np.full(12, 2.0)}
        view = MODEL.view(CAMERA, Pose.identity(), **field, **points)
    else:
        seen = Detection(1, 0, "car", 0.9, box, encode_mask(mask), mask.shape, pixels, np.full(12, 0.9))
        given = 0.0, seen, np.zeros_like(mask), list(range(12)), ObjectConfig()
        view = make_view(MODEL, CAMERA, Pose.identity(), *given)
    return pose.retract(rng.normal(0, [0.1] * 3 + [0.02] * 3)), rng.normal(0, 0.3, MODEL.mode_count), view


def object_case(rng, *, border=True, pose=False, modes=False, frozen=False):
    """An observation. Its linearization is kept and so is exact in itself; the smooth cost is evaluated anew.

    One that is frozen was linearized elsewhere, some tenths of a radian off.
    """
    camera_from_object, z, view = seen_car(rng, border=border)
    camera, mounting, values = random_pose(rng), random_mounting(rng), gtsam.Values()
    insert_camera(values, 3, camera, mounting, rng)
    insert_mounting(values, mounting, rng)
    values.insert(O(7), to_pose3(camera @ camera_from_object))
    values.insert(Z(7), z)
    keys, rate = (X(3), V(3), E(0), T(0)), rng.normal(0, 0.3, 3)
    where = (O(7) if pose else camera @ camera_from_object), (Z(7) if modes else None)
    noise = NoiseModel() if border else NoiseModel(keypoint_position_sigma_m=0.0)  # else sigma follows the depth
    held, anew, beside = (
        ViewTerm(ObservationCost(MODEL, view, noise, focal), keys, CameraMemo(mounting.translation, rate), *where)
        for focal in (1e-9, 1e9, 1e-9)
    )
    if frozen:
        elsewhere = camera_from_object.retract(rng.normal(0, [0.5] * 3 + [0.2] * 3)), z + rng.normal(0, 0.3, len(z))
        for term in (held, beside):
            term.cost.freeze(*elsewhere)
    widths = dict(zip(keys, (6, 3, 3, 1), strict=True))
    widths |= ({O(7): 6} if pose else {}) | ({Z(7): MODEL.mode_count} if modes else {})
    factor, true_cost = view_factor(held), view_factor(held if border else anew)
    return Case(factor, values, widths, true_cost, tolerance=1e-5, term=beside)


for border in (True, False):
    what = "mask and key points" if border else "key points alone, linearized at every value"
    makes(object_factor, f"object, fixed: {what}")(lambda rng, b=border: object_case(rng, border=b))
    makes(object_factor, f"object, its pose a key: {what}")(lambda rng, b=border: object_case(rng, border=b, pose=True))
    makes(object_factor, f"object, pose and modes keys: {what}")(
        lambda rng, b=border: object_case(rng, border=b, pose=True, modes=True)
    )
makes(object_factor, "object, frozen, seen from elsewhere")(
    lambda rng: object_case(rng, pose=True, modes=True, frozen=True)
)


# --- measurements


@makes(point_factor, "point tracks of one length")
def points_case(rng, lengths=(5,)):
    """Static points ahead of a camera that drives, by tracks of several lengths."""
    world, mounting, values, frames = random_pose(rng), random_mounting(rng), gtsam.Values(), range(2, 7)
    cameras = [
        world @ Pose(exp_so3(rng.normal(0, 0.01, 3)), [0.05 * k, 0.02 * k, 1.1 * k] + rng.normal(0, 0.02, 3))
        for k in range(len(frames))
    ]
    tracks = []
    for length in lengths:
        points = world.transform(
            np.column_stack([rng.uniform(-8, 8, 25), rng.uniform(-3, 1.5, 25), rng.uniform(12, 40, 25)])
        )
        pixels = np.stack([CAMERA.project(c.inverse().transform(points)) for c in cameras[:length]], axis=1)
        tracks.append(pixels + rng.normal(0, 0.3, pixels.shape))
    for frame, camera in zip(frames, cameras, strict=True):
        insert_camera(values, frame, camera.retract(rng.normal(0, 1e-4, 6)), mounting, rng)
    insert_mounting(values, mounting, rng)
    keys = {f: (X(f), V(f), E(0), T(0)) for f in frames}
    memos = {f: CameraMemo(mounting.translation, rng.normal(0, 0.05, 3)) for f in frames}
    block = PointTracks(0, frames[0], tuple(tracks), True, np.zeros((0, 2, 2)))
    term = point_term(block, keys, memos, CAMERA, PointConfig())
    widths = {X(f): 6 for f in frames} | {E(0): 3, T(0): 1}
    return Case(point_factor(term), values, widths, tolerance=2e-3, term=term)


@makes(point_factor, "point tracks of several lengths")
def points_of_several_lengths_case(rng):
    return points_case(rng, lengths=(3, 4, 5))


@makes(road_factor, "wheels on the road")
def road_case(rng):
    values = gtsam.Values()
    values.insert(X(2), to_pose3(random_pose(rng)))
    values.insert(O(5), to_pose3(random_pose(rng)))
    factor = road_factor(X(2), O(5), rng.normal(0, 1, 3), rng.normal(1, 0.5), rng.uniform(0.05, 0.5))
    return Case(factor, values, {X(2): 6, O(5): 6})


@makes(displacement_factor, "displacement near its measurement")
def displacement_case(rng, share=1.01):
    one, arm, values = random_pose(rng), rng.normal(0, 1, 3), gtsam.Values()
    other = one @ Pose(exp_so3(rng.normal(0, 0.3, 3)), rng.normal(0, 1.5, 3))
    values.insert(X(2), to_pose3(one))
    values.insert(X(6), to_pose3(other))
    displacement_m = share * float(np.linalg.norm(other.transform(arm) - one.transform(arm)))
    factor = displacement_factor([X(2), X(6)], arm, displacement_m, 0.03)
    return Case(factor, values, {X(2): 6, X(6): 6}, is_robust=True)


@makes(displacement_factor, "displacement far beyond its kernel")
def wild_displacement_case(rng):
    return displacement_case(rng, share=2.0)


@makes(start_pose_factor, "the first camera's pose")
def start_case(rng):
    """All sigmas are one number, so that whitening is a factor."""
    given, mounting, values = random_pose(rng), random_mounting(rng), gtsam.Values()
    insert_camera(values, 0, given.retract(rng.normal(0, 0.2, 6)), mounting, rng)
    insert_mounting(values, mounting, rng)
    sigma_deg = float(np.degrees(0.1))
    start = StartConfig(position_sigma_m=0.1, rotation_sigma_deg=sigma_deg, heading_sigma_deg=sigma_deg)
    keys, memo = (X(0), V(0), E(0), T(0)), CameraMemo(mounting.translation, rng.normal(0, 0.3, 3))
    factor = start_pose_factor(start, given, keys, memo)
    return Case(factor, values, dict(zip(keys, (6, 3, 3, 1), strict=True)))


# --- linear ones


@makes(linear_factor, "linear, of two vectors")
def linear_case(rng):
    values = gtsam.Values()
    values.insert(Z(1), rng.normal(size=4))
    values.insert(S(0), rng.normal(size=1))
    factor = linear_factor(Z(1), rng.normal(size=(5, 4)), S(0), rng.normal(size=(5, 1)), rng.uniform(0.3, 3))
    return Case(factor, values, {Z(1): 4, S(0): 1})


@makes(rows_factor, "rows over all kinds of variables")
def rows_case(rng):
    """At the values that the rows are about: elsewhere they are a linear model, by intent."""
    values = gtsam.Values()
    values.insert(X(1), to_pose3(random_pose(rng)))
    values.insert(V(1), rng.normal(size=3))
    values.insert(B(1), gtsam.imuBias.ConstantBias(rng.normal(size=3), rng.normal(size=3)))
    values.insert(E(0), gtsam.Rot3(exp_so3(rng.normal(size=3))))
    values.insert(T(0), rng.normal(size=1))
    keys = [(E(0), 3), (T(0), 1), (V(1), 3), (X(1), 6), (B(1), 6)]
    return Case(rows_factor(keys, rng.normal(size=(8, 20)), values), values, dict(keys))


# --- the battery


BATTERY = pytest.mark.parametrize("seed", SEEDS)
OVER_ALL = pytest.mark.parametrize("case", [pytest.param(case, id=name) for name, (_, case) in TABLE.items()])
OVER_RESIDUALS = pytest.mark.parametrize(
    "case", [pytest.param(case, id=name) for name, (function, case) in TABLE.items() if function not in REDUCED]
)


def moved(case, key, step):
    """The values, one variable moved by GTSAM's retraction."""
    delta = gtsam.VectorValues()
    for each in case.values.keys():  # noqa: SIM118 # no mapping
        width = case.widths.get(each, np.size(case.values.zeroVectors().at(each)))
        delta.insert(each, step if each == key else np.zeros(width))
    return case.values.retract(delta)


def linearized(case):
    """Whitened Jacobian by key, and residual."""
    linear = case.factor.linearize(case.values)
    jacobian, right = linear.jacobian()
    keys = list(linear.keys())
    ends = np.cumsum([0, *(case.widths[key] for key in keys)])
    blocks = {key: jacobian[:, ends[i] : ends[i + 1]] for i, key in enumerate(keys)}
    assert ends[-1] == jacobian.shape[1]
    return blocks, -right


def residual_of(factor, values):
    """The residual itself, before it is whitened where GTSAM tells it."""
    if isinstance(factor, gtsam.NoiseModelFactor):
        return factor.unwhitenedError(values)
    return -factor.linearize(values).jacobian()[1]


def differences(case, function):
    """Central differences of a function of the values, by key: (rows, width)."""
    out = {}
    for key, width in case.widths.items():
        columns = [
            (function(moved(case, key, STEP * e)) - function(moved(case, key, -STEP * e))) for e in np.eye(width)
        ]
        out[key] = np.array(columns).T / (2 * STEP)
    return out


@OVER_ALL
@BATTERY
def test_keys_widths_and_cost_are_those_that_are_meant(case, seed):
    case = case(np.random.default_rng(seed))
    assert list(case.factor.keys()) == list(case.widths)
    blocks, residual = linearized(case)
    assert set(blocks) == set(case.widths)
    if not case.is_robust:
        assert 0.5 * residual @ residual == pytest.approx(case.factor.error(case.values), rel=1e-9)
    assert residual @ residual > 0  # a residual of zero would make every law below an empty one


@OVER_RESIDUALS
@BATTERY
def test_derivatives_are_the_central_differences(case, seed):
    case = case(np.random.default_rng(seed))
    blocks, whitened = linearized(case)
    plain = residual_of(case.factor, case.values)
    sigmas = float(whitened @ plain) / float(plain @ plain)  # one over sigma, times the robust weight's root
    assert np.allclose(whitened, sigmas * plain)
    found = differences(case, lambda values: residual_of(case.factor, values))
    scale = max(np.abs(block).max() for block in blocks.values())
    for key, block in blocks.items():
        assert block == pytest.approx(sigmas * found[key], abs=case.tolerance * scale), gtsam.DefaultKeyFormatter(key)


@OVER_ALL
@BATTERY
def test_the_gradient_is_that_of_the_true_cost(case, seed):
    case = case(np.random.default_rng(seed))
    blocks, residual = linearized(case)
    cost = case.true_cost or case.factor
    found = differences(case, lambda values: np.array([cost.error(values)]))
    scale = max(np.abs(block.T @ residual).max() for block in blocks.values())
    for key, block in blocks.items():
        gradient = block.T @ residual
        assert gradient == pytest.approx(found[key][0], abs=10 * case.tolerance * scale), gtsam.DefaultKeyFormatter(key)


def equations(factors, case):
    """Hessian and gradient of a window's factors over the case's variables, in the order of their keys."""
    system = factors.system(case.values, case.widths)
    for key, width in case.widths.items():  # without these a variable may be free
        system.add_information([key], np.eye(width), np.zeros(width))
    solution = system.solve(list(case.widths))
    whole = np.linalg.inv(solution.covariance(sorted(case.widths)))
    return whole - np.eye(len(whole)), -whole @ solution.step


@OVER_ALL
@BATTERY
def test_among_many_a_factor_says_what_it_says_alone(case, seed):
    case = case(np.random.default_rng(seed))
    blocks, residual = linearized(case)
    jacobian = np.hstack([blocks[key] for key in sorted(blocks)])
    hessian, gradient = jacobian.T @ jacobian, jacobian.T @ residual
    together = WindowFactors([(case.factor, None)] * 2 + [(case.factor, case.term)])
    assert together.cost(case.values) == pytest.approx(3 * case.factor.error(case.values), rel=1e-9)
    found, slope = equations(together, case)
    assert found == pytest.approx(3 * hessian, abs=1e-6 * np.abs(hessian).max())
    assert slope == pytest.approx(3 * gradient, abs=1e-6 * np.abs(gradient).max())


@OVER_ALL
@BATTERY
def test_a_factor_that_is_settled_is_the_same_linear_one_everywhere(case, seed):
    rng = np.random.default_rng(seed)
    case, window = case(rng), Window()
    window.values = case.values
    entry = window.add(case.factor)
    window.settle([entry])
    step = gtsam.VectorValues()
    for key, width in case.widths.items():
        step.insert(key, rng.normal(0, 0.3, width))
    there = replace(case, values=window.values.retract(step))
    together = WindowFactors([(entry.factor, entry.term)])
    assert together.cost(there.values) == pytest.approx(entry.factor.error(there.values), rel=1e-9)
    linear = gtsam.GaussianFactorGraph()
    linear.push_back(entry.factor.linearize(there.values))
    jacobian, right = linear.jacobian(ordered(sorted(case.widths)))
    found, slope = equations(together, there)
    assert found == pytest.approx(jacobian.T @ jacobian, abs=1e-6 * np.abs(found).max())
    assert slope == pytest.approx(-jacobian.T @ right, abs=1e-6 * np.abs(slope).max())


def ordered(keys):
    ordering = gtsam.Ordering()
    for key in keys:
        ordering.push_back(key)
    return ordering


def test_views_of_several_frames_and_objects_are_told_apart():
    rng = np.random.default_rng(8)
    mounting, values, terms = random_mounting(rng), gtsam.Values(), []
    insert_mounting(values, mounting, rng)
    world = random_pose(rng)
    for frame in range(3):
        insert_camera(values, frame, world @ Pose(np.eye(3), np.array([0.0, 0.0, 0.3 * frame])), mounting, rng)
    memos = [CameraMemo(mounting.translation, rng.normal(0, 0.3, 3)) for _ in range(3)]
    for number in range(3):
        camera_from_object, z, view = seen_car(rng, border=True)
        values.insert(O(number), to_pose3(world @ camera_from_object))
        values.insert(Z(number), z)
        for frame in range(number, 3):
            keys = X(frame), V(frame), E(0), T(0)
            for place, modes in ((O(number), Z(number)), (O(number), None), (world @ camera_from_object, None)):
                terms.append(
                    ViewTerm(ObservationCost(MODEL, view, NoiseModel(), 400.0), keys, memos[frame], place, modes)
                )
    terms = [terms[k] for k in rng.permutation(len(terms))]
    singles = [replace(term, cost=ObservationCost(MODEL, term.cost.view, NoiseModel(), 400.0)) for term in terms]
    factors = [view_factor(single) for single in singles]
    widths = {key: int(values.extract([key]).dim()) for key in values.keys()}  # noqa: SIM118 # no mapping
    alone = Case(factors[0], values, widths)
    one, many = (WindowFactors(zip(factors, given, strict=True)) for given in ([None] * len(terms), terms))
    assert many.cost(values) == pytest.approx(one.cost(values), rel=1e-9)
    for found, expected in zip(equations(many, alone), equations(one, alone), strict=True):
        assert found == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())
    # near the linearizations they serve again, far from them they are made anew; both as one by one
    turn = np.array([0.02, 0.02, 0.02, 0.0, 0.0, 0.0])
    for sizes in ({"x": 1e-5, "o": 1e-5, "z": 1e-5}, {"x": 0.05}, {"z": 0.5}, {"o": turn}):
        step = gtsam.VectorValues()
        for key, width in widths.items():
            step.insert(key, sizes.get(chr(key >> 56), 0.0) * rng.uniform(0.5, 1.0, width))
        values, evaluations = values.retract(step), [term.cost.evaluations for term in terms]
        assert many.cost(values) == pytest.approx(one.cost(values), rel=1e-9)
        again = [term.cost.evaluations for term in terms]
        assert again == [single.cost.evaluations for single in singles]
        assert (evaluations == again) == (len(sizes) == 3)


def test_every_module_of_factors_is_in_the_table():
    rooms = Path(meshslam.graph.__file__).parent
    modules = {f"meshslam.graph.{path.stem}" for path in rooms.glob("*_factor.py")}
    assert modules
    assert modules <= {function.__module__ for function, _ in TABLE.values()}
