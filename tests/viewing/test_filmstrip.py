import base64
import threading
from dataclasses import replace

import cv2
import numpy as np
import pytest

from meshslam.geometry import render
from meshslam.viewing import draw_overlay, filmstrip, jpeg_uri, overlay, write_report
from meshslam.viewing import mesh_layer as layers
from meshslam.viewing.filmstrip import choose_frames, draw_frame
from meshslam.viewing.thumbnail import THUMB_PX


def _decoded(uri):
    return cv2.imdecode(np.frombuffer(base64.b64decode(uri.partition(",")[2]), np.uint8), cv2.IMREAD_COLOR)


@pytest.mark.parametrize("with_image", [True, False])
def test_a_thumbnail_looks_like_the_overlay(context, with_image, monkeypatch):
    for module in (filmstrip, overlay):  # labels follow the page's size, not the image's
        monkeypatch.setattr(module, "place_labels", lambda *_: {})
    for index in (0, 5):
        image = cv2.GaussianBlur(context.read_image(index), (0, 0), 9) if with_image else None
        pose, found = context.world_from_camera[index], context.found_at(index)
        thumb = _decoded(draw_frame(context, index, image).thumbnail)
        whole = draw_overlay(image, context.camera, pose, context.map, found)
        expected = _decoded(jpeg_uri(cv2.resize(whole, thumb.shape[1::-1], interpolation=cv2.INTER_AREA), 70))
        assert thumb.shape[1] == THUMB_PX
        difference = np.abs(thumb.astype(int) - expected).mean()
        ground = np.full_like(whole, 216) if image is None else image
        bare = cv2.resize(ground, thumb.shape[1::-1], interpolation=cv2.INTER_AREA)
        assert difference < 0.5 * np.abs(bare.astype(int) - expected).mean()


def test_each_frame_is_drawn_and_unpacked_once_and_no_finer_than_it_is_shown(context, monkeypatch):
    drawn, unpacked = [], []

    def noted(camera, meshes, rect=None):
        drawn.append((camera.width, rect))
        return render(camera, meshes, rect)

    monkeypatch.setattr(layers, "render", noted)
    mask = type(context.detections.detections[0]).mask
    monkeypatch.setattr(type(context.detections.detections[0]), "mask", lambda d: unpacked.append(d.id) or mask(d))
    draw_frame(context, 0, context.read_image(0))
    assert {width for width, _ in drawn} == {layers.SAMPLES * context.camera.width}
    assert sum(width * height for _, (_, _, width, height) in drawn) < 0.5 * 4 * context.camera.width * 140
    assert sorted(unpacked) == sorted(d.id for d in context.found_at(0))


def test_an_image_is_read_once_and_few_are_held(context):
    read, threads = [], set()

    def noted(index):
        read.append(index)
        threads.add(threading.get_ident())
        return context.read_image(index)

    page = write_report(replace(context, read_image=noted))
    assert len(read) == len(set(read))
    assert set(read) >= set(choose_frames(context))
    assert len(threads) <= 2
    assert page == write_report(context)
