import contextlib
import io

import numpy as np
import pytest
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from meshslam.evaluation.average_precision import (
    COCO_RECALLS,
    KITTI_RECALLS,
    Judged,
    average_precision,
    judge,
)


def judged(scores, right, count):
    return Judged(np.array(scores, float), np.array(right, float), count)


def test_all_right_is_one():
    for recalls in (KITTI_RECALLS, COCO_RECALLS):
        assert average_precision(judged([0.9, 0.5], [1, 1], 2), recalls) == 1.0
        assert average_precision(judged([], [], 2), recalls) == 0.0
        assert average_precision(judged([0.9], [0], 2), recalls) == 0.0


def test_known_answer_by_hand():
    """Of four true things the answers find, in their order: right, wrong, right.

    Precision is 1 up to a recall of 1/4, then 2/3 up to 1/2, then 0: over 40 points 10 * 1 + 10 * 2/3.
    """
    found = average_precision(judged([0.9, 0.8, 0.7], [1, 0, 1], 4), KITTI_RECALLS)
    assert found == pytest.approx((10 + 10 * 2 / 3) / 40)


def test_a_wrong_answer_that_is_least_sure_costs_nothing():
    assert average_precision(judged([0.9, 0.8, 0.1], [1, 1, 0], 2), KITTI_RECALLS) == 1.0
    assert average_precision(judged([0.9, 0.8, 0.95], [1, 1, 0], 2), KITTI_RECALLS) == pytest.approx(2 / 3)


def test_the_order_of_answers_of_one_score_says_nothing():
    one, two = judged([0.5, 0.5, 0.5], [1, 0, 1], 2), judged([0.5, 0.5, 0.5], [0, 1, 1], 2)
    assert average_precision(one, KITTI_RECALLS) == average_precision(two, KITTI_RECALLS) == pytest.approx(2 / 3)


def test_what_does_not_count_is_neither_right_nor_wrong():
    frames = [([0.9, 0.8, 0.7], [True, True, False], [True, False])]
    table = {(0, 0): 1.0, (1, 1): 1.0}
    found = judge(frames, lambda frame, answer, truth: table.get((answer, truth)))
    assert (found.scores.tolist(), found.right.tolist(), found.true_count) == ([0.9], [1.0], 1)


def test_a_true_thing_is_found_once():
    found = judge([([0.9, 0.8], [True, True], [True])], lambda frame, answer, truth: 1.0)
    assert found.right.tolist() == [1.0, 0.0]


@pytest.mark.parametrize("seed", range(4))
def test_it_is_coco_s(seed):
    """Random boxes in 12 images, against pycocotools at an overlap of 0.5."""
    rng = np.random.default_rng(seed)
    true, found = [], []
    for image in range(12):
        for x, y, w, h in rng.uniform(5, 60, (rng.integers(1, 5), 4)):
            true.append({"image_id": image, "bbox": [x, y, w, h], "area": w * h, "iscrowd": 0, "category_id": 1})
            if rng.random() < 0.8:
                box = (np.array([x, y, w, h]) + rng.normal(0, 4, 4)).tolist()
                found.append({"image_id": image, "bbox": box, "score": float(rng.random()), "category_id": 1})
        box = rng.uniform(5, 60, 4).tolist()
        found.append({"image_id": image, "bbox": box, "score": float(rng.random()), "category_id": 1})
    for number, row in enumerate(true, 1):
        row["id"] = number
    with contextlib.redirect_stdout(io.StringIO()):
        coco = COCO()
        coco.dataset = {"images": [{"id": i} for i in range(12)], "categories": [{"id": 1}], "annotations": true}
        coco.createIndex()
        theirs = COCOeval(coco, coco.loadRes(found), "bbox")
        theirs.params.areaRng, theirs.params.areaRngLbl = theirs.params.areaRng[:1], ["all"]
        theirs.evaluate()
        theirs.accumulate()
    of_image = [([t for t in true if t["image_id"] == i], [f for f in found if f["image_id"] == i]) for i in range(12)]
    frames = [([f["score"] for f in fs], [True] * len(fs), [True] * len(ts)) for ts, fs in of_image]

    def quality(frame, answer, truth):
        (ax, ay, aw, ah), (bx, by, bw, bh) = of_image[frame][1][answer]["bbox"], of_image[frame][0][truth]["bbox"]
        both = max(0, min(ax + aw, bx + bw) - max(ax, bx)) * max(0, min(ay + ah, by + bh) - max(ay, by))
        iou = both / (aw * ah + bw * bh - both)
        return iou if iou >= 0.5 else None

    ours = average_precision(judge(frames, quality), COCO_RECALLS)
    assert 0 < ours < 1
    assert ours == pytest.approx(theirs.eval["precision"][0, :, 0, 0, 2].mean(), abs=1e-9)
