"""The shipped network on drawn cars that it has not seen, and how its answers get into detections."""

import numpy as np
import pytest

from meshslam.errors import ModelError
from meshslam.perception import (
    CategoryEntry,
    Detection,
    DetectionSet,
    ImageEntry,
    KeypointConfig,
    KeypointFinder,
    add_keypoints,
    encode_mask,
    read_detections,
    write_detections,
)
from meshslam.perception.keypoints.decode import peak_angle
from meshslam.training.pictures import draw_samples


@pytest.fixture(scope="module")
def finder():
    return KeypointFinder(KeypointConfig(threads=1))


@pytest.fixture(scope="module")
def samples():
    return draw_samples(987_654_321, 48)


def found_in(finder, samples):
    masks = [(cut[..., 3] > 127).astype(np.uint8) for cut in samples.cuts]
    return [finder.find(cut[..., :3].copy(), [mask])[0] for cut, mask in zip(samples.cuts, masks, strict=True)]


def test_the_shipped_network_finds_points_and_angles_of_drawn_cars(finder, samples):
    cars = found_in(finder, samples)
    pixels = np.array([car.pixels for car in cars])
    shown = samples.visible > 0
    off = np.linalg.norm(pixels - samples.keypoints, axis=2) / samples.boxes_px.max(1)[:, None]
    assert (off[shown] < 0.1).mean() > 0.9
    turn = np.abs(np.angle(np.exp(1j * (peak_angle(np.array([c.angle_shares for c in cars])) - samples.angles_rad))))
    assert np.degrees(np.median(turn)) < 6
    assert (turn > np.pi / 2).mean() < 0.1
    scores = np.array([car.scores for car in cars])
    assert scores[shown].mean() > 0.6 > 0.3 > scores[~shown].mean()


def test_a_batch_answers_as_one_by_one(finder, samples):
    image, mask = samples.cuts[0][..., :3].copy(), (samples.cuts[0][..., 3] > 127).astype(np.uint8)
    alone, *others = finder.find(image, [mask] * 11)
    for car in others:
        assert car.pixels == pytest.approx(alone.pixels, abs=1e-2)


def scene(samples):
    image = np.full((300, 400, 3), 90, np.uint8)
    mask = np.zeros((300, 400), np.uint8)
    image[100:196, 150:278] = samples.cuts[1][..., :3]
    mask[100:196, 150:278] = samples.cuts[1][..., 3] > 127
    cut = np.roll(mask, 240, axis=1)
    cut[:, :200] = 0
    size, box = (300, 400), (150.0, 100.0, 128.0, 96.0)
    detections = (
        Detection(1, 0, "truck", 0.9, box, encode_mask(mask), size),
        Detection(2, 0, "person", 0.9, box, encode_mask(mask), size),
        Detection(3, 0, "car", 0.9, (300.0, 100.0, 100.0, 96.0), encode_mask(cut), size),
    )
    categories = tuple(CategoryEntry(i, name) for i, name in enumerate(("car", "truck", "person")))
    return image, DetectionSet((ImageEntry(0, "000000.png", 400, 300),), categories, detections)


def test_vehicles_get_key_points_others_and_cut_ones_none_and_the_file_keeps_them(finder, samples, tmp_path):
    image, plain = scene(samples)
    found = add_keypoints(plain, lambda _: image, finder)
    assert [d.keypoints is not None for d in found.detections] == [True, False, False]
    (tmp_path / "d.json").write_bytes(write_detections(found))
    again = read_detections(tmp_path / "d.json")
    assert again.keypoint_names("truck") == finder.names
    for key in ("keypoints", "keypoint_scores", "keypoint_sigmas_px"):
        assert (getattr(again.detections[0], key) == getattr(found.detections[0], key)).all()
    assert again.detections[0].viewing_angle_shares == pytest.approx(found.detections[0].viewing_angle_shares, abs=1e-3)
    assert add_keypoints(again, lambda _: image, finder) is again


def test_a_file_that_is_no_key_point_network_is_named(tmp_path):
    with pytest.raises(ModelError, match="no such file"):
        KeypointFinder(KeypointConfig(model=str(tmp_path / "no.onnx")))
    (tmp_path / "x.onnx").write_bytes(b"x")
    with pytest.raises(ModelError, match="is no key point network"):
        KeypointFinder(KeypointConfig(model=str(tmp_path / "x.onnx")))
