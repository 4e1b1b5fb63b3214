import cv2
import numpy as np
import pytest

from meshslam.errors import SequenceError
from meshslam.features.image_features import FeatureTracker, ImageFeatures
from meshslam.features.point_tracks import PointConfig, PointTracker, free_mask
from meshslam.perception.flow import grey

SHIFT = np.array([3.0, -2.0])  # px a frame, of all that is static
CONFIG = PointConfig(corners=60, steps=4)


@pytest.fixture(scope="module")
def images():
    noise = np.random.default_rng(2).normal(128, 50, (260, 420)).astype(np.float32)
    big = np.clip(cv2.GaussianBlur(noise, (0, 0), 1.5) * 3 - 256, 0, 255).astype(np.uint8)
    moved = [np.float32([[1, 0, SHIFT[0] * k - 60], [0, 1, SHIFT[1] * k - 40]]) for k in range(10)]
    return [cv2.warpAffine(big, m, (300, 180)) for m in moved]


def blocks_of(images, config, row=0, free=None):
    tracker = PointTracker(config, row)
    mask = free_mask((180, 300), (), config) if free is None else free
    return [tracker.step(grey(image), mask) for image in images]


def test_corners_move_with_the_image(images):
    blocks = [b for b in blocks_of(images, CONFIG) if b.is_closed]
    assert [b.first for b in blocks] == [0, 4]
    for block in blocks:
        assert block.last == block.first + 4
        steps = np.concatenate([np.diff(t, axis=1).reshape(-1, 2) for t in block.tracks])
        assert len(steps) > 100
        assert np.allclose(np.median(steps, axis=0), SHIFT, atol=0.02)
        assert (np.linalg.norm(steps - SHIFT, axis=1) < 0.3).mean() > 0.98


def test_an_open_block_grows_and_no_observation_is_in_two_tracks(images):
    blocks = blocks_of(images[:4], CONFIG)
    assert [b.is_closed for b in blocks] == [False] * 4
    assert [max((t.shape[1] for t in b.tracks), default=0) for b in blocks] == [0, 0, 3, 4]
    last = [t[:, -1] for t in blocks[3].tracks if t.shape[1] == 4]
    assert len(np.unique(np.round(np.concatenate(last), 3), axis=0)) == sum(map(len, last))
    assert np.allclose(blocks[3].matches[:, 1] - blocks[3].matches[:, 0], SHIFT, atol=1.0)


def test_rows_are_staggered(images):
    firsts = [[b.first for b in blocks_of(images, CONFIG, row) if b.is_closed] for row in (0, 1)]
    assert firsts == [[0, 4], [0, 2]]


def test_nothing_is_followed_where_something_may_move(images):
    free = free_mask((180, 300), (), CONFIG)
    free[:, 150:] = 0
    for block in blocks_of(images, CONFIG, free=free):
        for track in block.tracks:
            assert (track[..., 0] < 150.5).all()


def bgr(image):
    return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)


def test_features_are_handed_out_by_frame_until_they_are_forgotten(images):
    features = ImageFeatures(CONFIG)
    for image in images[:4]:
        features.take(bgr(image), ())
    assert features.matches(3).shape[1:] == (2, 2)
    assert features.frame_image(2).image.shape == images[2].shape
    features.forget_before(3)
    assert features.frame_image(3).free.any()
    with pytest.raises(SequenceError, match="frame 2 of the stream came without an image"):
        features.frame_image(2)


def test_saved_features_go_on_in_the_same_way(images):
    first, second = ImageFeatures(CONFIG), ImageFeatures(CONFIG)
    for image in images[:5]:
        first.take(bgr(image), ())
    second.fill(first.to_arrays())
    for index in range(5, 9):
        for features in (first, second):
            features.take(bgr(images[index]), ())
        for one, other in zip(first.point_tracks(index), second.point_tracks(index), strict=True):
            assert (one.first, one.is_closed) == (other.first, other.is_closed)
            assert all((a == b).all() for a, b in zip(one.tracks, other.tracks, strict=True))
    assert (first.frame_image(4).image == second.frame_image(4).image).all()


def test_a_tracker_may_begin_at_any_frame(images):
    one, other = FeatureTracker(CONFIG), FeatureTracker(CONFIG, first=7)
    for image in images:
        coloured = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
        first, second = one.measure(coloured, ()), other.measure(coloured, ())
        assert second.index == first.index + 7
        for a, b in zip(first.point_tracks, second.point_tracks, strict=True):
            assert (b.first, b.row, b.is_closed) == (a.first + 7, a.row, a.is_closed)
            assert all(np.array_equal(x, y) for x, y in zip(a.tracks, b.tracks, strict=True))


def test_features_measured_elsewhere_are_held_like_own_ones(images):
    own, given, elsewhere = ImageFeatures(CONFIG), ImageFeatures(CONFIG), FeatureTracker(CONFIG)
    for image in images[:6]:
        coloured = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
        own.take(coloured, ())
        given.put(elsewhere.measure(coloured, ()))
    assert np.array_equal(own.matches(5), given.matches(5))
    assert np.array_equal(own.frame_image(5).image, given.frame_image(5).image)
