"""Scores and assignments against their definitions."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshslam.perception.association import Followed, assign, assign_greedily, paper_score, size_ratio
from meshslam.perception.flow import Flow, scale_and_shift
from meshslam.perception.tracked_mask import TrackedMask, mask_iou, shared_area_px

SEEDS = st.integers(0, 10_000)
NO_POINTS, NO_WEIGHTS = np.zeros((0, 2)), np.zeros(0)


def tracked_mask(left, top, mask, keypoints=NO_POINTS, weights=NO_WEIGHTS):
    return TrackedMask("vehicle", left, top, mask, (60, 80), NO_POINTS, keypoints, weights)


def whole(s):
    image = np.zeros((60, 80), np.uint8)
    height, width = s.mask.shape
    image[s.top : s.top + height, s.left : s.left + width] = s.mask
    return image


def random_sight(rng, **points):
    mask = (rng.random((rng.integers(1, 30), rng.integers(1, 40))) > 0.4).astype(np.uint8)
    return tracked_mask(int(rng.integers(0, 40)), int(rng.integers(0, 30)), mask, **points)


@settings(max_examples=50, deadline=None)
@given(SEEDS)
def test_the_papers_score_is_its_sum(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 13))
    flows, tracked = [], []
    for _ in range(2):
        weights = np.where(rng.random(count) > 0.3, rng.random(count), 0.0)
        tracked.append(random_sight(rng, keypoints=rng.uniform(0, 60, (count, 2)), weights=weights))
        flows.append(rng.uniform(-5, 85, (count, 2)))
    none = Flow(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0, bool))
    one, other = (Followed(s, none, Flow(f, f, np.ones(count, bool))) for s, f in zip(tracked, flows, strict=True))
    expected = 0.0
    for k in range(count):
        lands = [_at(whole(s), f[k]) for s, f in ((tracked[1], flows[0]), (tracked[0], flows[1]))]
        if tracked[1].weights[k] > 0:
            expected += lands[0] * lands[1] * tracked[0].weights[k]
    assert paper_score(one, other) == pytest.approx(expected)


def _at(image, point):
    x, y = np.floor(point + 0.5).astype(int)
    return int(0 <= x < image.shape[1] and 0 <= y < image.shape[0] and image[y, x])


@settings(max_examples=50, deadline=None)
@given(SEEDS)
def test_masks_overlap_as_their_whole_images_do(seed):
    rng = np.random.default_rng(seed)
    one, other = random_sight(rng), random_sight(rng)
    a, b = whole(one), whole(other)
    assert shared_area_px(one, other) == (a & b).sum()
    assert mask_iou(one, other) == pytest.approx((a & b).sum() / max(1, (a | b).sum()))
    points = rng.uniform(-3, 83, (40, 2))
    np.testing.assert_array_equal(one.contains(points), [_at(a, p) > 0 for p in points])


@settings(max_examples=60, deadline=None)
@given(SEEDS, st.integers(0, 5), st.integers(0, 5))
def test_assignment_is_the_best_of_all_one_to_one(seed, rows, columns):
    scores = np.random.default_rng(seed).random((rows, columns))
    pairs = assign(scores, 0.3)
    assert len({r for r, _ in pairs}) == len({c for _, c in pairs}) == len(pairs)
    assert all(scores[p] >= 0.3 for p in pairs)
    gain = np.where(scores >= 0.3, scores, 0)
    tall = gain if rows <= columns else gain.T
    choices = itertools.permutations(range(max(rows, columns)), min(rows, columns))
    best = max(sum(tall[i, c] for i, c in enumerate(choice)) for choice in choices)
    assert sum(scores[p] for p in pairs) == pytest.approx(best)


def test_greedy_assignment_gives_every_row_its_best_column_once():
    scores = np.array([[0.9, 0.8, 0.0], [0.95, 0.1, 0.0], [0.0, 0.0, 0.0]])
    assert assign_greedily(scores) == [
        (1, 0)
    ]  # row 0 wanted column 0 and loses: the Hungarian method gives it column 1
    assert assign(scores, 0.3) == [(0, 1), (1, 0)]
    assert assign_greedily(np.zeros((0, 3))) == assign_greedily(np.zeros((3, 0))) == []


def test_sides_that_the_image_cuts_are_not_compared():
    inner, wide, cut = (tracked_mask(x, 20, np.ones((10, w), np.uint8)) for x, w in ((10, 20), (10, 50), (30, 50)))
    assert size_ratio(inner, wide) == size_ratio(wide, inner) == 2.5
    assert size_ratio(inner, cut) == 1.0
    assert size_ratio(inner, tracked_mask(10, 20, np.ones((30, 20), np.uint8))) == 3.0


@settings(max_examples=50, deadline=None)
@given(SEEDS, st.floats(0.6, 1.8))
def test_motion_is_found_among_outliers(seed, scale):
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 100, (40, 2))
    moved = scale * points + rng.uniform(-50, 50, 2)
    found, centre, new_centre = scale_and_shift(points, moved)
    assert found == pytest.approx(scale)
    np.testing.assert_allclose(scale * (points - centre) + new_centre, moved, atol=1e-9)
    moved[:6] += 30
    assert scale_and_shift(points, moved)[0] == pytest.approx(scale, rel=0.35)
