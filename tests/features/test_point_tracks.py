import dataclasses

import cv2
import numpy as np
import pytest

from meshslam.features.image_features import image_features_of
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


def test_pictures_are_looked_at_once_however_often_they_are_asked_for(images, drive, monkeypatch):
    read = []
    camera = dataclasses.replace(drive.camera, width=300, height=180)
    paths = tuple(drive.root / f"{k}.png" for k in drive.frame_ids)
    recording = dataclasses.replace(drive, camera=camera, image_paths=paths)

    def image(_self, index):
        read.append(index)
        return cv2.cvtColor(images[index % len(images)], cv2.COLOR_GRAY2BGR)

    monkeypatch.setattr(type(recording), "read_image", image)
    nothing = dataclasses.replace(_empty(recording), detections=())
    image_features = image_features_of(recording, nothing, CONFIG)
    first = [image_features.blocks(k) for k in range(6)]
    again = [image_features.blocks(k) for k in range(6)]
    assert read == list(range(6))
    assert all(a is b for one, other in zip(first, again, strict=True) for a, b in zip(one, other, strict=True))
    assert image_features_of(drive, nothing, CONFIG) is None


def _empty(recording):
    from meshslam.perception import DetectionSet
    from meshslam.perception.detections import ImageEntry

    entries = tuple(ImageEntry(k, f"{k}.png", 300, 180) for k in recording.frame_ids)
    return DetectionSet(entries, (), ())
