"""Laws of suppression: what is kept does not overlap, what is dropped overlaps something better."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from meshslam.perception.instances import without_passengers
from meshslam.perception.suppression import (
    Patch,
    box_iou,
    clean_mask,
    owners,
    share_out,
    shared_area_px,
    suppress_boxes,
    suppress_nested,
)

SEEDS = st.integers(0, 10_000)


def random_boxes(rng, count):
    corner = rng.uniform(0, 60, (count, 2))
    return np.concatenate([corner, corner + rng.uniform(0, 40, (count, 2)) * (rng.random((count, 1)) > 0.1)], 1)


def random_patches(rng, count, side=40):
    patches = []
    for _ in range(count):
        top, left = rng.integers(0, side - 4, 2)
        rows, columns = rng.integers(1, side - top + 1), rng.integers(1, side - left + 1)
        patches.append(Patch(int(left), int(top), rng.normal(0.3, 1, (rows, columns)).astype(np.float32)))
    return patches


def pasted(patch, values, side=40):
    whole = np.zeros((side, side), values.dtype)
    whole[patch.place] = values
    return whole


def test_overlap_of_boxes_is_that_of_their_pixels():
    boxes = np.array([[0, 0, 4, 4], [2, 2, 6, 6], [10, 10, 12, 20], [3, 3, 3, 3]], float)
    grid = np.zeros((4, 30, 30), bool)
    for cells, (x0, y0, x1, y1) in zip(grid, boxes.astype(int), strict=True):
        cells[y0:y1, x0:x1] = True
    flat = grid.reshape(4, -1).astype(float)
    shared = flat @ flat.T
    union = flat.sum(1)[:, None] + flat.sum(1) - shared
    np.testing.assert_allclose(box_iou(boxes, boxes), np.divide(shared, union, where=union > 0, out=np.zeros((4, 4))))


@settings(max_examples=60, deadline=None)
@given(SEEDS, st.integers(0, 40), st.floats(0.1, 0.9))
def test_suppressed_boxes_have_a_better_one_of_their_group(seed, count, threshold):
    rng = np.random.default_rng(seed)
    boxes, scores = random_boxes(rng, count), np.round(rng.random(count), 1)
    groups = rng.integers(0, 2, count)
    kept = suppress_boxes(boxes, scores, groups, threshold)
    twins = (box_iou(boxes, boxes) > threshold) & (groups[:, None] == groups)
    assert (np.diff(scores[kept]) <= 0).all()
    inner = twins[np.ix_(kept, kept)]
    assert not (inner & ~np.eye(len(kept), dtype=bool)).any()
    for dropped in set(range(count)) - set(kept.tolist()):
        better = [k for k in kept if twins[dropped, k]]
        assert max(scores[better]) >= scores[dropped]


@settings(max_examples=60, deadline=None)
@given(SEEDS, st.integers(0, 6))
def test_patches_share_what_their_whole_images_share(seed, count):
    rng = np.random.default_rng(seed)
    patches = random_patches(rng, count)
    whole = [pasted(p, p.inside) for p in patches]
    for p, a in zip(patches, whole, strict=True):
        for q, b in zip(patches, whole, strict=True):
            assert shared_area_px(p, q) == (a & b).sum()
    owner = owners(patches, 40, 40)
    np.testing.assert_array_equal(owner >= 0, np.any([np.zeros((40, 40), bool), *whole], axis=0))
    strongest = np.max([np.zeros((40, 40)), *(pasted(p, p.logits) for p in patches)], axis=0)
    for i, patch in enumerate(patches):
        np.testing.assert_array_equal(pasted(patch, patch.logits)[owner == i], strongest[owner == i])
    masks = share_out(patches, rng.random(count) > 0.5, 40, 40)
    assert sum((pasted(p, m) for p, m in zip(patches, masks, strict=True)), np.zeros((40, 40))).max() <= 1


def test_solid_objects_have_holes_only_where_another_object_is():
    ring = np.ones((30, 30), np.float32)
    ring[8:22, 8:22] = -1
    inner = Patch(10, 10, np.ones((6, 6), np.float32))
    for solid, area in ((True, 900 - 36), (False, 900 - 196)):
        masks = share_out([Patch(0, 0, ring), inner], [solid, False], 40, 40)
        assert [int(m.sum()) for m in masks] == [area, 36]


def test_a_driver_is_part_of_the_car_and_a_pedestrian_is_not():
    car = np.ones((30, 60), np.float32)
    car[5:15, 10:20] = -1  # where the driver is seen
    car[10:, 40:50] = -1  # where the pedestrian hides it
    patches = [
        Patch(5, 5, car),
        Patch(15, 10, np.ones((10, 10), np.float32)),
        Patch(45, 15, np.ones((28, 10), np.float32)),
    ]
    vehicle = np.array([True, False, False])
    assert without_passengers([0, 1, 2], patches, vehicle) == [0, 2]
    assert without_passengers([1, 2], patches, vehicle) == [1, 2]
    assert without_passengers([0, 1], patches, np.array([True, True, False])) == [0, 1]


def test_of_nested_masks_the_first_is_kept_within_a_group():
    big, part, beside = (Patch(x, 0, np.ones((20, w), np.float32)) for x, w in ((0, 20), (12, 10), (18, 20)))
    empty = Patch(0, 0, -np.ones((5, 5), np.float32))
    same, apart = np.zeros(3), np.array([0, 1, 0])
    assert suppress_nested([big, part, beside], same, 0.75) == [0, 2]
    assert suppress_nested([part, big, beside], same, 0.75) == [0, 2]
    assert suppress_nested([big, part, beside], apart, 0.75) == [0, 1, 2]
    assert suppress_nested([big, empty], np.zeros(2), 0.75) == [0]


def test_specks_go_holes_fill_and_large_parts_stay():
    mask = np.zeros((60, 60), np.uint8)
    mask[5:35, 5:25] = 1
    mask[5:35, 28:40] = 1  # the other half of a car behind a pole
    expected = mask.copy()
    mask[50:52, 50:52] = 1
    mask[10:12, 10:12] = 0
    np.testing.assert_array_equal(clean_mask(mask), expected)
    mask[15:30, 8:20] = expected[15:30, 8:20] = 0  # what is open to the eye is no hole
    np.testing.assert_array_equal(clean_mask(mask), expected)
    for plain in (np.zeros((4, 4), np.uint8), np.ones((4, 4), np.uint8)):
        np.testing.assert_array_equal(clean_mask(plain), plain)
