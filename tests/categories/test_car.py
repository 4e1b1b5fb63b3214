"""The shipped category `car`."""

import numpy as np
import pytest
import trimesh

from meshslam.categories import category_names
from meshslam.categories.build import build_car

NAMES = (
    "left_front_wheel left_back_wheel right_front_wheel right_back_wheel upper_left_windshield upper_right_windshield "
    "upper_left_rearwindow upper_right_rearwindow left_front_light right_front_light left_back_trunk right_back_trunk"
)
FLIP = np.array([1.0, -1.0, 1.0])


def draw(car, rng, limit=2.0):
    return car.shape(np.clip(rng.normal(size=len(car.modes)), -limit, limit))


def test_topology(car):
    assert "car" in category_names()
    assert car.vertices.shape == (642, 3)
    assert car.faces.shape == (1280, 3)
    assert (car.mirror == np.arange(642)).sum() == 32
    assert 1 <= len(car.modes) <= 20


def test_mean_and_modes_are_exactly_symmetric(car):
    np.testing.assert_array_equal(car.vertices[car.mirror] * FLIP, car.vertices)
    np.testing.assert_array_equal(car.modes[:, car.mirror] * FLIP, car.modes)
    mirrored = {tuple(np.roll(f, -f.argmin())) for f in car.mirror[car.faces][:, ::-1]}
    assert mirrored == {tuple(np.roll(f, -f.argmin())) for f in car.faces}


def test_the_origin_is_the_centre_of_the_mean(car):
    np.testing.assert_allclose(car.vertices.max(0) + car.vertices.min(0), 0, atol=1e-6)


def test_every_shape_is_closed_and_outward(car, rng):
    assert trimesh.Trimesh(car.vertices, car.faces, process=False).is_watertight
    for _ in range(30):
        volume = trimesh.Trimesh(draw(car, rng), car.faces, process=False).volume
        assert 3.0 < volume < 18.0


def test_faces_do_not_fold(car, rng):
    """Neighbouring faces of the mean never turn back on each other, those of drawn shapes hardly ever."""

    def folds(vertices):
        mesh = trimesh.Trimesh(vertices, car.faces, process=False)
        return int((mesh.face_adjacency_angles > np.deg2rad(120)).sum())

    assert folds(car.vertices) == 0
    assert np.mean([folds(draw(car, rng)) for _ in range(20)]) < 2  # of 1920 edges


def test_sizes_are_those_of_real_cars(car, rng):
    length, width, height = car.dimensions
    assert 4.3 < length < 4.8
    assert 1.75 < width < 2.0
    assert 1.45 < height < 1.7
    sizes = np.array([np.ptp(draw(car, rng), axis=0) for _ in range(100)])
    assert (sizes.min(0) > [3.0, 1.45, 1.1]).all()
    assert (sizes.max(0) < [6.3, 2.35, 2.3]).all()
    assert (sizes.std(0) > [0.25, 0.04, 0.06]).all()


def test_modes_fall_in_size(car):
    rms = np.sqrt((car.modes**2).sum(2).mean(1))
    assert rms[0] > 0.08
    assert rms[-1] < 0.3 * rms[0]
    assert (rms > 0).all()


def test_key_points_lie_where_their_names_say(car, rng):
    assert car.keypoint_names == tuple(NAMES.split())
    np.testing.assert_allclose(car.keypoint_weights.sum(1), 1, atol=1e-12)
    assert ((car.keypoint_weights != 0).sum(1) <= 12).all()
    for vertices in [car.vertices, *(draw(car, rng) for _ in range(20))]:
        points = dict(zip(car.keypoint_names, car.keypoints(vertices), strict=True))
        for name, point in points.items():
            assert (point[1] > 0) == ("left" in name), name
        for side in ("left", "right"):
            assert points[f"{side}_front_light"][0] > points[f"{side}_front_wheel"][0] > 0.6
            assert points[f"{side}_front_wheel"][0] > points[f"upper_{side}_windshield"][0]
            assert points[f"upper_{side}_windshield"][0] > points[f"upper_{side}_rearwindow"][0]
            assert points[f"{side}_back_trunk"][0] < points[f"{side}_back_wheel"][0] < -0.6
            assert points[f"upper_{side}_windshield"][2] > points[f"{side}_back_trunk"][2]
            assert points[f"{side}_back_trunk"][2] > points[f"{side}_back_wheel"][2]


def test_key_points_lie_on_the_surface(car, rng):
    for vertices in [car.vertices, *(draw(car, rng) for _ in range(5))]:
        mesh = trimesh.Trimesh(vertices, car.faces, process=False)
        away = trimesh.proximity.closest_point(mesh, car.keypoints(vertices))[1]
        assert away.max() < 0.06


def test_left_and_right_key_points_are_mirror_images(car):
    points = dict(zip(car.keypoint_names, car.keypoints(car.vertices), strict=True))
    for name, point in points.items():
        if "left" in name:
            np.testing.assert_allclose(points[name.replace("left", "right")], point * FLIP, atol=1e-12)


def test_wheel_vertices_touch_the_ground_at_four_corners(car, rng):
    wheels = car.wheel_vertices
    assert 8 <= len(wheels) <= 20
    assert set(car.mirror[wheels]) == set(wheels)
    for vertices in [car.vertices, *(draw(car, rng) for _ in range(20))]:
        touching = vertices[wheels]
        assert len({(x > 0, y > 0) for x, y, _ in touching}) == 4
        assert touching[:, 2].mean() - vertices[:, 2].min() < 0.06
        under_body = vertices[np.abs(vertices[:, 1]) < 0.3, 2].min()
        assert under_body > touching[:, 2].mean() + 0.05


def test_the_front_is_the_hood_end(car):
    """The roof's middle lies behind the car's middle, and the front end is lower than the rear end."""
    roof = car.vertices[car.vertices[:, 2] > car.vertices[:, 2].max() - 0.1]
    assert roof[:, 0].mean() < -0.1
    top = {s: car.vertices[s * car.vertices[:, 0] > 1.6, 2].max() for s in (1, -1)}
    assert top[1] < top[-1]


def test_the_shipped_file_is_what_the_code_builds(car):
    built = build_car()
    np.testing.assert_array_equal(built.faces, car.faces)
    np.testing.assert_array_equal(built.wheel_vertices, car.wheel_vertices)
    np.testing.assert_allclose(built.vertices, car.vertices, atol=1e-5)
    np.testing.assert_allclose(built.modes, car.modes, atol=1e-3)
    np.testing.assert_allclose(built.keypoint_weights, car.keypoint_weights, atol=1e-4)


@pytest.mark.data
def test_real_cars_are_reached_by_the_modes(car, data_folder):
    """Least squares on closest points from the mean alone leaves real cars' surfaces a few centimetres away."""
    gaps = []
    for path in sorted((data_folder / "cars").glob("*.ply"))[::6]:
        real = trimesh.load(path, process=False)
        gaps.append(fitted_gap(car, np.asarray(trimesh.sample.sample_surface(real, 4000, seed=0)[0])))
    assert len(gaps) >= 3
    assert np.mean(gaps) < 0.018
    assert max(gaps) < 0.03


def fitted_gap(car, points):
    """Median distance of points to the mesh of modes that fits them best."""
    centre = (points.max(0) + points.min(0)) / 2
    z, offset = np.zeros(len(car.modes)), centre
    for _ in range(6):
        mesh = trimesh.Trimesh(car.shape(z) + offset, car.faces, process=False)
        closest, distance, face = trimesh.proximity.closest_point(mesh, points)
        share = trimesh.triangles.points_to_barycentric(mesh.triangles[face], closest)
        normal = mesh.face_normals[face]
        moves = np.einsum("mpck,pc,pk->pm", car.modes[:, car.faces[face]], share, normal)
        system = np.hstack([moves, normal]) / np.maximum(distance, 0.02)[:, None] ** 0.5
        residual = ((points - closest) * normal).sum(1) / np.maximum(distance, 0.02) ** 0.5
        system = np.vstack([system, np.eye(len(z), len(z) + 3)])
        step = np.linalg.lstsq(system, np.concatenate([residual, -z]), rcond=None)[0]
        z, offset = z + step[: len(z)], offset + step[len(z) :]
    return float(np.median(distance))
