import dataclasses

import numpy as np
import pytest

from meshslam.categories import Category, load_category, save_category
from meshslam.categories.category import category_bytes
from meshslam.errors import CategoryError


def test_shape_is_linear_in_z(car, rng):
    a, b = rng.normal(size=(2, len(car.modes)))
    np.testing.assert_allclose(car.shape(a) + car.shape(b), car.shape(a + b) + car.vertices, atol=1e-12)
    np.testing.assert_array_equal(car.shape(np.zeros(len(car.modes))), car.vertices)
    np.testing.assert_allclose(car.shape(a[:2]), car.shape(np.r_[a[:2], np.zeros(len(a) - 2)]), atol=1e-12)


def test_key_points_move_with_the_mesh(car, rng):
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    shift = rng.normal(size=3)
    moved = car.keypoints(car.vertices @ rotation.T + shift)
    np.testing.assert_allclose(moved, car.keypoints(car.vertices) @ rotation.T + shift, atol=1e-12)


@pytest.mark.parametrize("shape", [(99,), (2, 2), ()])
def test_wrong_z_is_refused(car, shape):
    with pytest.raises(CategoryError, match="mode weights"):
        car.shape(np.zeros(shape))


def test_save_and_load_keep_everything_to_the_byte(small_car, tmp_path):
    path = tmp_path / "mine.npz"
    save_category(small_car, path)
    loaded = load_category(path)
    assert category_bytes(loaded) == path.read_bytes() == category_bytes(small_car)
    np.testing.assert_allclose(loaded.vertices, small_car.vertices, atol=1e-6)
    np.testing.assert_array_equal(loaded.mirror, small_car.mirror)
    assert loaded.keypoint_names == small_car.keypoint_names
    assert load_category(str(path)).name == "car"


def test_loading_errors_name_what_and_where(small_car, tmp_path):
    with pytest.raises(CategoryError, match=r"'carr'.*car"):
        load_category("carr")
    with pytest.raises(CategoryError, match=r"no category file at .*gone\.npz"):
        load_category(tmp_path / "gone.npz")
    broken = tmp_path / "broken.npz"
    for data in (b"", b"not a zip", category_bytes(small_car)[:2000]):
        broken.write_bytes(data)
        with pytest.raises(CategoryError, match=r"broken\.npz"):
            load_category(broken)


def test_a_missing_key_or_another_format_is_named(small_car, tmp_path):
    save_category(small_car, tmp_path / "whole.npz")
    arrays = dict(np.load(tmp_path / "whole.npz"))
    without = {k: v for k, v in arrays.items() if k != "mirror"}
    np.savez(tmp_path / "part.npz", **without)
    with pytest.raises(CategoryError, match=r"part\.npz.*'mirror'"):
        load_category(tmp_path / "part.npz")
    np.savez(tmp_path / "other.npz", **(arrays | {"format": np.array("something-9")}))
    with pytest.raises(CategoryError, match="something-9"):
        load_category(tmp_path / "other.npz")
    np.savez(tmp_path / "text.npz", **(arrays | {"vertices": np.array(["a", "b"])}))
    with pytest.raises(CategoryError, match=r"text\.npz"):
        load_category(tmp_path / "text.npz")


def changed(category: Category, field: str, change) -> Category:
    array = getattr(category, field).copy()
    return dataclasses.replace(category, **{field: change(array)})


def put(index, value):
    def change(array):
        array[index] = value
        return array

    return change


@pytest.mark.parametrize(
    ("field", "change", "message"),
    [
        ("vertices", put((0, 0), np.nan), "vertices holds NaN"),
        ("modes", put((0, 0, 0), np.inf), "modes holds NaN"),
        ("faces", put((0, 0), 642), "faces names vertices"),
        ("faces", put((0, 0), -1), "faces names vertices"),
        ("wheel_vertices", put(0, 10_000), "wheel_vertices names"),
        ("mirror", put(0, 1), "involution"),
        ("vertices", put((0, 2), 9.0), "vertices are not symmetric"),
        ("modes", put((0, 0, 0), 9.0), "modes are not symmetric"),
        ("keypoint_weights", put((0, 0), 0.5), "sum to 1"),
        ("modes", lambda a: a[:, :-1], "modes has shape"),
        ("faces", lambda a: a[:, :2], "faces has shape"),
        ("faces", lambda a: a[:0], "no faces"),
    ],
)
def test_a_wrong_category_cannot_be_made(small_car, field, change, message):
    with pytest.raises(CategoryError, match=message):
        changed(small_car, field, change)
