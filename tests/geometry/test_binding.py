"""Values cross to the native module by the names of their attributes."""

from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest

from meshslam import _core  # noqa: TID251 - the binding itself is tested
from meshslam.errors import GeometryError
from meshslam.geometry import Camera, GroundPlane, NoiseModel, ObjectModel, Pose, coverage, render

CAMERA = Camera(60, 40, 50.0, 52.0, 30.0, 20.0, 0.5)
NOISE = NoiseModel()
GROUND = GroundPlane(np.array([0.0, 0.0, 1.0]), 0.2, 0.05, 0.03)
TRIANGLE = (np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
AHEAD = Pose(np.eye(3), np.array([0.0, 0.0, 4.0]))


@pytest.fixture(scope="module")
def model():
    vertices, faces = TRIANGLE
    return ObjectModel(vertices, faces, np.zeros((0, 3, 3)), None, np.zeros((0, 3)), np.zeros(0, int))


def _without(fields, name):
    return SimpleNamespace(**{key: value for key, value in fields.items() if key != name})


def _refine(model, ground, noise):
    return model.refine([], ground, noise, model.state_at(AHEAD), modes=False, free_form=False, max_iterations=0)


def test_whatever_has_the_attributes_of_a_camera_is_one():
    by_dataclass = coverage(CAMERA, AHEAD, *TRIANGLE)
    by_names = coverage(SimpleNamespace(**asdict(CAMERA)), AHEAD, *TRIANGLE)
    np.testing.assert_array_equal(by_dataclass, by_names)
    assert by_dataclass.max() == 1.0


@pytest.mark.parametrize("name", ["width", "height", "fx", "fy", "cx", "cy", "skew"])
def test_an_attribute_that_a_camera_has_not_is_named(name):
    with pytest.raises(GeometryError, match=f"a camera is not complete: .*no attribute '{name}'"):
        render(_without(asdict(CAMERA), name), [(AHEAD, *TRIANGLE)], rect=(0, 0, 5, 5))


def test_an_attribute_of_another_type_is_named():
    with pytest.raises(GeometryError, match="fx"):
        render(SimpleNamespace(**asdict(CAMERA) | {"fx": "wide"}), [(AHEAD, *TRIANGLE)], rect=(0, 0, 5, 5))


@pytest.mark.parametrize("name", sorted(set(asdict(NOISE)) - {"surface_sigma_m"}))
def test_each_field_of_the_noise_is_read_by_its_name(model, name):
    with pytest.raises(GeometryError, match=f"a noise model is not complete: .*no attribute '{name}'"):
        _refine(model, None, _without(asdict(NOISE), name))
    with pytest.raises(GeometryError, match=f"the noise model's {name} must .*, found -1"):
        _refine(model, None, SimpleNamespace(**{**asdict(NOISE), name: -1.0}))


@pytest.mark.parametrize("name", ["normal", "offset_m", "height_sigma_m", "tilt_sigma_rad"])
def test_each_field_of_the_ground_is_read_by_its_name(model, name):
    with pytest.raises(GeometryError, match=f"a ground plane is not complete: .*no attribute '{name}'"):
        _refine(model, _without(vars(GROUND), name), NOISE)
    broken = {"normal": np.array([0.0, 0.0, 2.0]), "offset_m": np.nan}.get(name, -1.0)
    with pytest.raises(GeometryError, match=f"the ground needs .*{name}"):
        _refine(model, replace(GROUND, **{name: broken}), NOISE)


def test_a_problem_takes_no_argument_by_its_place():
    with pytest.raises(TypeError, match="positional"):
        _core.Problem([], None, NOISE, False, False, False, None)
    with pytest.raises(TypeError, match="smoothness"):
        _core.ObjectState(world_from_object=np.eye(4), z=np.zeros(0), d=np.zeros(0), smoothness=0.0)
