"""The mean shape of a drive's cars."""

from dataclasses import replace

import numpy as np
import pytest

from meshslam.geometry import Pose
from meshslam.mapping import MappingConfig, map_objects
from meshslam.mapping.common_shape import about, common_shape, scene_about
from meshslam.mapping.pipeline import make_scene
from meshslam.mapping.selection import usable_tracks
from meshslam.mapping.work import first_pass
from meshslam.maps import CameraPath
from meshslam.moving import ShapeEvidence
from meshslam.objects import ObjectConfig, Occluders, category_model, centred


def test_it_is_the_posterior_mean_of_the_joint_problem(rng):
    """Slow twin: all shapes and mu in one least-squares problem."""
    modes, sigma, count = 3, 0.7, 5
    rows = [rng.normal(size=(4, modes)) * rng.uniform(0.1, 3) for _ in range(count)]
    data = [row @ rng.normal(0.4, 1, modes) + rng.normal(size=4) for row in rows]
    evidence = []
    for row, seen in zip(rows, data, strict=True):
        covariance = np.linalg.inv(row.T @ row + np.eye(modes))
        evidence.append(ShapeEvidence(covariance @ row.T @ seen, covariance))

    size = modes * (count + 1)  # mu comes last
    system, right = np.zeros((size, size)), np.zeros(size)
    system[-modes:, -modes:] += np.eye(modes) / sigma**2
    for i, (row, seen) in enumerate(zip(rows, data, strict=True)):
        own = slice(modes * i, modes * (i + 1))
        system[own, own] += row.T @ row + np.eye(modes)
        system[own, -modes:] -= np.eye(modes)
        system[-modes:, own] -= np.eye(modes)
        system[-modes:, -modes:] += np.eye(modes)
        right[own] += row.T @ seen
    assert np.allclose(common_shape(evidence, sigma), np.linalg.solve(system, right)[-modes:], atol=1e-8)


def test_there_is_none_without_cars_or_where_it_is_not_wanted():
    assert common_shape([], 0.5) is None
    assert common_shape([ShapeEvidence(np.ones(2), 0.1 * np.eye(2))], 0.0) is None


def test_counted_from_another_mean_a_car_is_the_same(frames, tracked, car, rng):
    scene = make_scene(frames, tracked, car, ObjectConfig())
    occluders = Occluders(frames.camera, tracked.by_frame(), frames.pose_of_frame())
    [track, *_], _ = usable_tracks(frames, tracked, "car", MappingConfig(), 24.0)
    work = first_pass(track, scene, occluders)
    mu = rng.normal(0, 0.5, len(car.modes))
    moved, other = about(work, mu), scene_about(scene, mu)
    for name in ("start", "posed", "modes", "state"):
        one, two = getattr(work.found, name), getattr(moved.found, name)
        assert np.allclose(other.model.vertices(two), scene.model.vertices(one), atol=1e-9)
        assert np.allclose(two.z, one.z - mu)


@pytest.fixture(scope="module")
def narrow_street(camera, car, car_detection, as_set, drive):
    """Cars a tenth narrower than the category's, passed closely, and one ahead that shows its side alone."""
    vertices = car.vertices * np.array([1.0, 0.9, 1.0])
    poses, found = drive(14, 0.8), []
    places = [(x, 3.0 * (-1) ** k) for k, x in enumerate((7.0, 8.5, 13.5, 15.0, 20.0))]
    bodies = [Pose.from_yaw(0.05 * k, np.array([x, y, car.dimensions[2] / 2])) for k, (x, y) in enumerate(places)]
    bodies.append(Pose.from_yaw(np.pi / 2, np.array([32.0, 0.0, car.dimensions[2] / 2])))
    for i, pose in enumerate(poses):
        for number, body in enumerate(bodies, 1):
            ahead = (pose.inverse() @ body).translation
            if ahead[2] > 4 and abs(camera.project(ahead[None])[0, 0] - 320) < 300:
                found.append(car_detection(len(found) + 1, i, pose, body, vertices, track=number))
    frames = CameraPath(camera, tuple(range(14)), np.arange(14) * 0.1, poses, 1.65)
    return frames, as_set(14, found), float(np.ptp(vertices[:, 1]))


def test_what_a_car_does_not_show_is_as_with_the_others_of_its_drive(narrow_street, car):
    frames, found, width_m = narrow_street
    config = MappingConfig()

    def width_of_the_last(config):
        mapped = map_objects(frames, found, car, ObjectConfig(), config, fixed_tracks=True).map
        assert len(mapped) == 6
        return mapped[6].dimensions[1]

    alone, with_others = (width_of_the_last(c) for c in (replace(config, common_shape_sigma=0.0), config))
    assert abs(with_others - width_m) < 0.7 * abs(alone - width_m)


def test_stages_and_meshes_on_the_way_are_those_of_the_category(narrow_street, car):
    frames, found, _ = narrow_street
    told = []
    mapped = map_objects(
        frames,
        found,
        car,
        ObjectConfig(),
        MappingConfig(),
        fixed_tracks=True,
        on_objects=lambda all_: told.append(all_),
    )
    model = category_model(car)
    for thing in mapped.map.objects:
        last = centred(model, mapped.stages[thing.id].shaped)
        assert np.allclose(last.vertices, thing.vertices, atol=1e-9)
        widths = [np.ptp(one.vertices[:, 1]) for objects in told for one in objects if one.id == thing.id]
        assert max(np.abs(np.diff(widths[-3:]))) < 0.1
    assert {thing.id for thing in told[-1]} >= {thing.id for thing in mapped.map.objects}
