import re

import cv2
import numpy as np

from meshslam.categories import load_category
from meshslam.viewing.category_sheet import SHOWN, category_page, category_png, category_sheet, mode_rms
from meshslam.viewing.mesh_drawing import TILE


def test_the_sheet_shows_the_mean_and_each_mode():
    car = load_category("car")
    sheet = category_sheet(car)
    assert sheet.shape == (TILE[1] * (1 + SHOWN), TILE[0] * 4, 3)
    tiles = sheet.reshape(1 + SHOWN, TILE[1], 4, TILE[0], 3).swapaxes(1, 2)
    assert ((tiles[..., 20:, :, :] < 250).any(-1).mean((2, 3)) > 0.01).all()  # something is drawn on each
    less, more = tiles[1, 0].astype(int), tiles[1, 1].astype(int)
    assert (np.abs(less - more)[20:].max(-1) > 30).mean() > 0.005  # the first mode moves the outline
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(category_png(car), np.uint8), 1), sheet)


def test_the_front_is_to_the_right_in_the_side_view():
    car = load_category("car")
    side = category_sheet(car)[: TILE[1], : TILE[0]]
    red = np.argwhere((side[:, :, 2] > 200) & (side[:, :, 1] < 60))
    names = list(car.keypoint_names)
    x = car.keypoints(car.vertices)[:, 0]
    assert red[:, 1].max() > TILE[0] / 2 + 20
    assert names[int(x.argmax())].endswith("front_light")


def test_the_page_needs_nothing_else():
    page = category_page(load_category("bus"))
    assert "left_front_wheel" in page
    assert not re.search(r"(src|href)=.?https?:", page)
    assert page.count("<tr>") == len(mode_rms(load_category("bus")))
