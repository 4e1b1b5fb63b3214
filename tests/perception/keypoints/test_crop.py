import numpy as np

from meshslam.perception.keypoints.crop import GREY, HEIGHT_PX, WIDTH_PX, Crop, cut_out, to_input


def test_points_come_back_from_the_input():
    rng = np.random.default_rng(0)
    for _ in range(50):
        crop = Crop.around(tuple(rng.uniform([-20, -20, 3, 3], [400, 200, 500, 300])))
        points = rng.uniform(-50, 700, (20, 2))
        assert np.allclose(crop.to_image(crop.to_input(points)), points)


def test_a_bright_pixel_lands_where_points_say():
    image = np.zeros((120, 300), np.uint8)
    image[60:64, 200:204] = 255  # its middle is at (201.5, 61.5)
    crop = Crop.around((150, 30, 100, 60))
    cut = crop.cut(image, 0).astype(float)
    rows, columns = np.indices(cut.shape)
    middle = np.array([(cut * columns).sum(), (cut * rows).sum()]) / cut.sum()
    assert np.allclose(middle, crop.to_input(np.array([201.5, 61.5])), atol=0.3)


def test_beyond_the_image_there_is_grey_and_no_mask():
    image, mask = np.full((40, 40), 250, np.uint8), np.ones((40, 40), np.uint8)
    cut = cut_out(image, mask, Crop.around((0, 0, 40, 40)))
    assert cut.shape == (HEIGHT_PX, WIDTH_PX, 4)
    assert (cut[0, 0] == [GREY, GREY, GREY, 0]).all()
    assert (cut[HEIGHT_PX // 2, WIDTH_PX // 2] == [250, 250, 250, 255]).all()


def test_exposure_changes_little_of_the_input():
    rng = np.random.default_rng(1)
    cut = rng.integers(40, 120, (1, HEIGHT_PX, WIDTH_PX, 4)).astype(np.uint8)
    cut[..., 3] = 255
    brighter = cut.copy()
    brighter[..., :3] = 2 * cut[..., :3]
    assert np.abs(to_input(cut) - to_input(brighter)).max() < 0.3
