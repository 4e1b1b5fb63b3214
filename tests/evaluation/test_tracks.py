import numpy as np
import pytest

from meshslam.evaluation.tracks import TrackDrive, TrackFrame, hota_figures, idf1_figures, mota_figures, track_drive
from meshslam.perception import CategoryEntry, Detection, DetectionSet, ImageEntry, encode_mask

# HOTA, DetA, AssA, MOTA, switches, misses, false positives and IDF1 of random_drive(seed) by TrackEval 1.3.0
TRACKEVAL = {
    0: (0.328879851911, 0.510228322956, 0.212307828383, 0.165217391304, 32, 28, 36, 0.478991596639),
    1: (0.240744096043, 0.367907371605, 0.158843081455, -0.338461538462, 22, 15, 50, 0.327272727273),
    2: (0.249988482133, 0.361805846352, 0.173372319073, 0.244094488189, 22, 64, 10, 0.34),
}


def random_drive(seed):
    rng = np.random.default_rng(seed)
    true_count, count, frames = int(rng.integers(2, 6)), int(rng.integers(2, 7)), []
    for k in range(30):
        truths, estimates = np.flatnonzero(rng.random(true_count) < 0.8), np.flatnonzero(rng.random(count) < 0.8)
        similarity = rng.random((len(truths), len(estimates))) ** 3
        for i, a in enumerate(truths):
            for j, b in enumerate(estimates):
                if a == (b if k < 15 else (b + 1) % count):
                    similarity[i, j] = rng.uniform(0.4, 1)
        frames.append(TrackFrame(truths, estimates, similarity))
    return TrackDrive(tuple(frames), true_count, count)


def drive(*frames):
    """Frames of (true tracks, estimated tracks); an estimate covers the truth at its place in the list."""
    made = tuple(TrackFrame(np.array(t, int), np.array(e, int), np.eye(len(t), len(e))) for t, e in frames)
    counts = [max((n for f in frames for n in f[side]), default=-1) + 1 for side in (0, 1)]
    return TrackDrive(made, *counts)


def figures(found):
    return mota_figures(found) | idf1_figures(found) | hota_figures(found)


@pytest.mark.parametrize("seed", TRACKEVAL)
def test_figures_are_those_of_trackeval(seed):
    found = figures(random_drive(seed))
    keys = ("hota", "hota_deta", "hota_assa", "mota", "mota_id_switches", "mota_misses", "mota_false_positives", "idf1")
    np.testing.assert_allclose([found[key] for key in keys], TRACKEVAL[seed], atol=1e-11)


def test_a_perfect_run():
    found = figures(drive(*[([0, 1], [1, 0])] * 10))
    assert {key: found[key] for key in ("hota", "hota_deta", "hota_assa", "mota", "idf1")} == dict.fromkeys(
        ("hota", "hota_deta", "hota_assa", "mota", "idf1"), 1.0
    )
    assert (found["mota_misses"], found["mota_false_positives"], found["mota_id_switches"]) == (0, 0, 0)


def test_a_track_that_is_cut_in_two_by_hand():
    """Ten frames, the number changes after five: each match shares 5 of 10 frames with its track."""
    found = figures(drive(*[([0], [0])] * 5, *[([0], [1])] * 5))
    assert found["mota"] == pytest.approx(0.9)
    assert found["mota_id_switches"] == 1
    assert found["idf1"] == pytest.approx(0.5)
    assert (found["hota_deta"], found["hota_assa"]) == (pytest.approx(1.0), pytest.approx(0.5))
    assert found["hota"] == pytest.approx(np.sqrt(0.5))


def test_misses_and_false_positives_by_hand():
    """Of ten true boxes four are missed, and there are two that nothing is behind."""
    found = figures(drive(*[([0], [0])] * 6, *[([0], [])] * 4, *[([], [1])] * 2))
    assert found["mota"] == pytest.approx(1 - 6 / 10)
    assert found["idf1"] == pytest.approx(2 * 6 / (10 + 8))
    assert found["hota_deta"] == pytest.approx(6 / 12)
    assert found["hota_assa"] == pytest.approx(6 / 10)


def test_no_estimate_is_nothing():
    found = figures(drive(*[([0], [])] * 3))
    assert (found["mota"], found["idf1"], found["hota"]) == (0.0, 0.0, 0.0)


def test_numbers_of_tracks_say_nothing(rng):
    one = random_drive(3)
    order = rng.permutation(one.estimated_count)
    frames = []
    for f in one.frames:
        turned = rng.permutation(len(f.estimates))
        frames.append(TrackFrame(f.truths, order[f.estimates][turned], f.similarity[:, turned]))
    two = TrackDrive(tuple(frames), one.true_count, one.estimated_count)
    assert figures(two) == pytest.approx(figures(one))


def test_a_match_of_the_frame_before_is_kept():
    """Two estimates over one truth: the worse of them had it before, and still overlaps enough."""
    frames = (
        TrackFrame(np.array([0]), np.array([0]), np.array([[0.9]])),
        TrackFrame(np.array([0]), np.array([0, 1]), np.array([[0.6, 0.8]])),
        TrackFrame(np.array([0]), np.array([0, 1]), np.array([[0.4, 0.8]])),
    )
    assert mota_figures(TrackDrive(frames, 1, 2))["mota_id_switches"] == 1


def detections(rows, frames=2):
    mask = encode_mask(np.ones((4, 4), np.uint8))
    images = tuple(ImageEntry(i, f"{i:06d}.png", 100, 50) for i in range(frames))
    found = [Detection(n, frame, "car", 0.9, box, mask, (4, 4), track_id=track) for n, frame, box, track in rows]
    return DetectionSet(images, (CategoryEntry(1, "car"),), tuple(found))


def test_tracks_are_read_from_boxes_not_from_annotation_ids():
    """A network's detections have ids of their own; one of no true object, and one without a track, are no match."""
    true = detections([(1, 0, (10, 10, 20, 10), 7), (2, 1, (12, 10, 20, 10), 7), (3, 1, (60, 10, 20, 10), 9)])
    given = {1: 4, 2: 4}
    found = track_drive(
        true,
        given,
        detections([(31, 0, (10, 10, 20, 10), 5), (30, 1, (12, 10, 20, 5), 5), (1, 1, (60, 10, 20, 10), None)]),
    )
    assert (found.true_boxes, found.estimated_boxes) == (2, 2)
    np.testing.assert_allclose(found.frames[1].similarity, [[0.5]])
    assert mota_figures(found)["mota"] == 1.0
