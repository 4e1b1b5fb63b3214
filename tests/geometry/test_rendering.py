"""The rasterizer against rays, pixel by pixel: open, closed, broken, many, and a car that the camera passes."""

import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.errors import GeometryError
from meshslam.geometry import Camera, MaskLoss, Pose, coverage, exp_so3, render
from tests.reference import area_iou, meshes
from tests.reference.ray_casting import cast

CAMERA = Camera(83, 61, 60.0, 57.0, 40.3, 29.8, 1.1)
CAR = load_category("car")
BODY = (CAR.vertices, CAR.faces)
AHEAD = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])


def turned(rng, distance_m):
    return Pose(exp_so3(rng.uniform(-2, 2, 3)), np.array([rng.uniform(-1, 1), rng.uniform(-1, 1), distance_m]))


def check(found, placed, camera=CAMERA, rect=None):
    objects, faces, depth = cast(camera, [(pose.transform(v), f) for pose, v, f in placed], rect)
    np.testing.assert_array_equal(found.object_index, objects)
    np.testing.assert_array_equal(found.face_index, faces)
    np.testing.assert_allclose(found.depth_m, depth, rtol=1e-6)
    np.testing.assert_array_equal(found.mask, objects >= 0)


def soup(rng):
    """Faces without order: edges of one to many faces, repeated corners, no area."""
    vertices = rng.uniform(-1.5, 1.5, (14, 3))
    faces = np.unique(
        np.sort(rng.integers(0, 14, (25, 3))), axis=0
    )  # no face twice: which is in front would be rounding
    return vertices, np.concatenate([faces, [[0, 0, 1], [2, 2, 2]]])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["car", "L-shape", "crossing shells", "open", "soup"])
def test_pixels_are_those_of_rays(kind, seed):
    rng = np.random.default_rng(seed)
    makers = {
        "car": lambda: BODY,
        "L-shape": meshes.l_shape,
        "crossing shells": meshes.crossing_shells,
        "open": lambda: meshes.open_half(*BODY),
        "soup": lambda: soup(rng),
    }
    vertices, faces = makers[kind]()
    placed = [(turned(rng, rng.uniform(3, 12)), vertices, faces)]
    check(render(CAMERA, placed), placed)
    drawer = MaskLoss(CAMERA, len(vertices), faces, np.zeros((1, 1), np.uint8))
    np.testing.assert_array_equal(drawer.draw(placed[0][0], vertices), render(CAMERA, placed).mask)


@pytest.mark.parametrize("distance_m", [0.3, 0.8, 1.6, 2.2])
def test_a_car_that_the_camera_passes_is_cut_at_the_near_plane(distance_m):
    pose = Pose(AHEAD @ Pose.from_yaw(0.1, np.zeros(3)).rotation, np.array([1.1, 0.6, distance_m]))
    placed = [(pose, *BODY)]
    depth = pose.transform(CAR.vertices)[:, 2]
    assert depth.min() < 0.1 < depth.max()
    found = render(CAMERA, placed)
    assert found.mask.any()
    check(found, placed)


def test_many_objects_hide_each_other_by_depth(rng):
    placed = [
        (turned(rng, d), *mesh) for d, mesh in ((9.0, BODY), (5.0, meshes.l_shape()), (6.0, soup(rng)), (4.0, BODY))
    ]
    found = render(CAMERA, placed)
    check(found, placed)
    assert len(np.unique(found.object_index)) >= 4
    back = render(CAMERA, placed[::-1])
    np.testing.assert_array_equal(np.where(back.object_index >= 0, 3 - back.object_index, -1), found.object_index)


def test_a_rectangle_is_a_window(rng):
    placed = [(turned(rng, 6.0), *BODY)]
    for rect in ((20, 10, 30, 25), (-7, 40, 60, 40)):
        check(render(CAMERA, placed, rect), placed, rect=rect)


def test_faces_that_share_edges_draw_each_pixel_once():
    # a fan around a pixel's centre, its edges along rows, columns and diagonals of pixel centres
    ring = np.array([[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1]]) * 8.0 + [20, 20]
    flat = Camera(41, 41, 1.0, 1.0, 0.0, 0.0)
    points = np.column_stack([np.concatenate([[[20.0, 20.0]], ring]), np.ones(9)])
    count = np.zeros((41, 41), int)
    for k in range(8):
        count += render(flat, [(Pose.identity(), points, np.array([[0, 1 + k, 1 + (k + 1) % 8]]))]).mask
    expected = np.zeros((41, 41), int)
    expected[12:28, 12:28] = 1  # left and top edges are in, right and bottom ones are not
    np.testing.assert_array_equal(count, expected)


@pytest.mark.parametrize("samples", [1, 3, 8])
def test_soft_coverage_is_the_share_of_samples(rng, samples):
    pose = turned(rng, 7.0)
    found = coverage(CAMERA, pose, *BODY, samples=samples)
    whole = (0, 0, CAMERA.width, CAMERA.height)
    np.testing.assert_array_equal(found, area_iou.shares(CAMERA, pose, *BODY, whole, samples))
    window = coverage(CAMERA, pose, *BODY, rect=(30, 5, 20, 50), samples=samples)
    np.testing.assert_array_equal(window, found[5:55, 30:50])


def test_soft_coverage_sums_to_the_area_and_adds_up_over_shared_edges(rng):
    square = np.array([[-0.61, -0.47, 1.0], [0.55, -0.33, 1.0], [0.48, 0.51, 1.0], [-0.5, 0.42, 1.0]]) * 3
    parts = [coverage(CAMERA, Pose.identity(), square, np.array([f]), samples=16) for f in ([0, 1, 2], [0, 2, 3])]
    both = coverage(CAMERA, Pose.identity(), square, np.array([[0, 1, 2], [0, 2, 3]]), samples=16)
    np.testing.assert_allclose(sum(parts), both, atol=1e-12)
    x, y = CAMERA.project(square).T
    area = 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert both.sum() == pytest.approx(area, rel=1e-3)


def test_empty_meshes_draw_nothing_and_bad_ones_are_named():
    nothing = (Pose.identity(), np.zeros((0, 3)), np.zeros((0, 3), int))
    assert not render(CAMERA, [nothing]).mask.any()
    assert not render(CAMERA, []).mask.any()
    assert not coverage(CAMERA, *nothing).any()
    one = np.array([[0.0, 0, 2], [1, 0, 2], [0, 1, 2]])
    with pytest.raises(GeometryError, match="face 1 names vertex -1"):
        render(CAMERA, [(Pose.identity(), one, np.array([[0, 1, 2], [0, -1, 2]]))])
    with pytest.raises(GeometryError, match="must be finite, but entry 3 is NaN"):
        render(
            CAMERA, [(Pose.identity(), np.where(np.arange(9).reshape(3, 3) == 4, np.nan, one), np.array([[0, 1, 2]]))]
        )
    with pytest.raises(GeometryError, match="samples must be from 1 to 64"):
        coverage(CAMERA, Pose.identity(), one, np.array([[0, 1, 2]]), samples=0)
