"""Views that are saved and read back are the same views, to the last bit."""

import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.errors import GeometryError
from meshslam.geometry import Camera, NoiseModel, Pose
from meshslam.objects import ObjectConfig, category_model, make_view, views_from_arrays, views_to_arrays
from meshslam.perception import Detection

CAMERA = Camera(320, 120, fx=300.0, fy=300.0, cx=160.0, cy=60.0)


@pytest.fixture(scope="module")
def model():
    return category_model(load_category("car"))


def views(model, rng):
    """Masks with holes and specks, cut by the image's edge and by occluders, with key points and without."""
    for k in range(6):
        y, x = np.mgrid[:120, :320]
        cx, cy = rng.uniform(0, 320), rng.uniform(20, 100)
        mask = ((x - cx) / rng.uniform(15, 60)) ** 2 + ((y - cy) / rng.uniform(8, 30)) ** 2 < 1
        mask &= rng.uniform(size=mask.shape) > 0.02
        mask[60, 160] = True
        occluder = np.asarray((x > cx + 5) & (k % 2 == 0), np.uint8)
        detection = Detection.from_mask(np.asarray(mask, np.uint8), id=k, frame=k)
        view = make_view(model, CAMERA, Pose.identity(), 0.0, detection, occluder, (), ObjectConfig())
        yield view.with_surface_sigma(0.1 * k)


def test_they_hold_the_same_and_cost_the_same(model, rng):
    made = list(views(model, rng))
    read = list(views_from_arrays(views_to_arrays(made), model, CAMERA))
    at = Pose(np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]), np.array([0.5, 1.0, 12.0]))
    for one, other in zip(made, read, strict=True):
        assert other.origin == one.origin
        assert other.surface_sigma_px == one.surface_sigma_px
        for a, b in zip(
            (*one.pictures(), one.border(), one.keypoints()),
            (*other.pictures(), other.border(), other.keypoints()),
            strict=True,
        ):
            assert np.array_equal(a, b)
        roots = [
            model.square_root(view, NoiseModel(), at, np.zeros(model.mode_count), modes=True) for view in (one, other)
        ]
        assert np.array_equal(roots[0].root, roots[1].root)


def test_of_none_there_are_none(model):
    assert list(views_from_arrays(views_to_arrays([]), model, CAMERA)) == []


def test_a_key_point_that_the_model_lacks_is_refused(model, rng):
    arrays = views_to_arrays(list(views(model, rng))[:1])
    arrays |= {"keypoints": np.array([[999.0, 1.0, 1.0, 1.0]]), "keypoint_counts": np.array([1])}
    with pytest.raises(GeometryError):
        list(views_from_arrays(arrays, model, CAMERA))
