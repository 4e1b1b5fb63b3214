import base64
import threading
from dataclasses import replace

import cv2
import numpy as np
import pytest

from meshslam.viewing import page_frames as module
from meshslam.viewing.page_frames import frames_data, page_frames, shown_frames


def unpack(text, kind, columns=1):
    return np.frombuffer(base64.b64decode(text), np.dtype(kind).newbyteorder("<")).reshape(-1, columns)


def decoded(frame):
    return cv2.imdecode(np.frombuffer(base64.b64decode(frame.image), np.uint8), cv2.IMREAD_COLOR)


@pytest.mark.parametrize("most", [2, 3, 7, 11, 300])
def test_frames_are_spread_from_the_first_to_the_last(context, most):
    shown = shown_frames(replace(context, frames_in_report=most))
    assert len(shown) == min(most, len(context.frame_ids))
    assert (shown[0], shown[-1]) == (0, len(context.frame_ids) - 1)
    assert np.ptp(np.diff(shown)) <= 1


def test_without_images_all_frames_are_shown(context):
    assert len(shown_frames(replace(context, frames_in_report=2, read_image=None))) == len(context.frame_ids)
    nothing = replace(context, frame_ids=(), world_from_camera=(), times_s=np.zeros(0))
    assert shown_frames(nothing) == []
    assert page_frames(nothing, []) == []


def test_masks_come_back_from_their_borders(context):
    frames = page_frames(context, shown_frames(context))
    data = frames_data(context, frames, np.zeros(3))
    lengths, points = unpack(data["border_lengths"], "u2")[:, 0], unpack(data["border_points"], "i2", 2)
    assert lengths.sum() == len(points)
    borders = iter(np.split(points, np.cumsum(lengths)[:-1]))
    for frame, told in zip(frames, data["detections"], strict=True):
        for detection, row in zip(context.found_at(frame.index), told, strict=True):
            mask = np.zeros(detection.image_size, np.uint8)
            cv2.fillPoly(mask, [next(borders).astype(np.int32) for _ in range(row["borders"])], 1)
            expected = detection.mask()
            assert (mask & expected).sum() / (mask | expected).sum() > 0.93
            assert row.get("track") == detection.track_id


def test_poses_are_relative_to_the_origin(context):
    frames, origin = page_frames(context, [0, 3]), np.array([5.0, -2.0, 1.0])
    rows = unpack(frames_data(context, frames, origin)["poses"], "f4", 12).reshape(-1, 3, 4)
    for row, index in zip(rows, (0, 3), strict=True):
        np.testing.assert_allclose(row[:, :3], context.world_from_camera[index].rotation, atol=1e-6)
        np.testing.assert_allclose(row[:, 3] + origin, context.world_from_camera[index].translation, atol=1e-6)


def test_images_are_the_frames_own(context):
    smooth = cv2.GaussianBlur(context.read_image(0), (0, 0), 9)
    [frame] = page_frames(replace(context, read_image=lambda _: smooth), [4])
    assert decoded(frame).shape == smooth.shape
    assert np.abs(decoded(frame).astype(int) - smooth).mean() < 3


def test_a_long_run_fits_its_share(context, monkeypatch):
    monkeypatch.setattr(module, "IMAGES_BYTES", 60_000)
    frames = page_frames(context, shown_frames(context))
    assert sum(len(frame.image) for frame in frames) < 60_000 * 4 / 3 * module.SLACK
    assert len({decoded(frame).shape for frame in frames}) == 1
    assert decoded(frames[0]).shape[1] >= module.NARROWEST_PX


def test_few_images_are_held(context):
    threads = set()

    def noted(index):
        threads.add(threading.get_ident())
        return context.read_image(index)

    page_frames(replace(context, read_image=noted), shown_frames(context))
    assert len(threads) <= module.WORKERS + 1  # and the one that measures
