"""Segmentation: real ONNX Runtime sessions on tiny networks that know two colours, and on a real network and frame."""

import cv2
import numpy as np
import pytest

from meshslam.errors import ModelError
from meshslam.perception import SegmenterConfig, detect, load_segmenter, write_detections
from meshslam.perception.coco import COCO_CLASSES
from tests.perception.networks import SIDE, cells, colour_network, other_network

RED, BLUE = (0, 0, 255), (255, 0, 0)  # BGR
PLAIN = SegmenterConfig(zoom=1.0, min_area_px=20)


def painted(height, width, rectangles):
    image = np.zeros((height, width, 3), np.uint8)
    for (x0, y0, x1, y1), colour in rectangles:
        image[y0:y1, x0:x1] = colour
    return image


def iou(mask, box):
    x0, y0, x1, y1 = box
    truth = np.zeros_like(mask)
    truth[y0:y1, x0:x1] = 1
    return (mask & truth).sum() / (mask | truth).sum()


@pytest.mark.parametrize("layout", ["v5", "v8"])
@pytest.mark.parametrize(
    ("height", "width"), [(64, 64), (40, 64), (64, 30), (60, 62), (128, 128), (375, 600), (20, 27)]
)
def test_masks_land_where_the_objects_are(tmp_path, layout, height, width):
    segmenter = load_segmenter(colour_network(tmp_path / "net.onnx", layout), PLAIN)
    boxes = [(width // 10, height // 5, width // 2, height // 2), (width * 6 // 10, height // 2, width, height)]
    found = segmenter.segment(painted(height, width, zip(boxes, (RED, BLUE), strict=True)))
    assert [i.name for i in found] == ["car", "person"]
    assert [i.score for i in found] == pytest.approx([0.9, 0.81], abs=1e-4)
    slack = 4 * max(1.0, max(height, width) / SIDE)  # a prototype's cell, in pixels of the image
    for instance, box in zip(found, boxes, strict=True):
        x, y, w, h = instance.bbox
        assert np.abs(np.array([x, y, x + w, y + h]) - box).max() <= slack / 2
        assert instance.mask.shape == (height, width)
        centre = np.argwhere(instance.mask).mean(0)[::-1] + 0.5
        np.testing.assert_allclose(centre, np.reshape(box, (2, 2)).mean(0), atol=slack / 4)


def test_borders_on_cells_are_exact(tmp_path):
    segmenter = load_segmenter(colour_network(tmp_path / "net.onnx"), PLAIN)
    (car,) = segmenter.segment(painted(SIDE, SIDE, [((16, 12, 48, 40), RED)]))
    assert iou(car.mask, (16, 12, 48, 40)) > 0.97
    assert car.bbox == (16.0, 12.0, 32.0, 28.0)


def test_what_the_zoom_sees_lands_in_the_same_place_and_finer(tmp_path):
    path = colour_network(tmp_path / "net.onnx", box=(8, 8, 56, 56))
    segmenter = load_segmenter(path, SegmenterConfig(zoom=2.0))
    box = (101, 110, 150, 141)
    image = painted(256, 256, [(box, RED)])
    whole, middle = segmenter._windows(256, 256)
    assert (whole, middle) == ((0, 0, 256, 256), (64, 64, 192, 192))
    shares = []
    for window in (whole, middle):
        mask = np.zeros((256, 256), np.uint8)
        patch = segmenter._look(image, window).patch(0)
        mask[patch.place] = patch.inside
        shares.append(iou(mask, box))
    assert shares[0] > 0.7
    assert shares[1] > max(0.85, shares[0])
    (car,) = segmenter.segment(image)
    assert iou(car.mask, box) > 0.7


def test_what_a_windows_border_cuts_is_left_to_the_whole_image(tmp_path):
    segmenter = load_segmenter(colour_network(tmp_path / "net.onnx"))
    image = painted(256, 256, [((50, 50, 200, 200), RED)])
    assert len(segmenter._look(image, (64, 64, 192, 192)).candidates.scores) == 0
    assert len(segmenter._look(image, (0, 0, 256, 256)).candidates.scores) == 2


def test_networks_of_open_size_take_the_image_as_it_is(tmp_path):
    segmenter = load_segmenter(colour_network(tmp_path / "net.onnx", dynamic=True), PLAIN)
    assert segmenter._input_size(375, 1242) == (384, 1248)
    assert segmenter._input_size(1000, 2000) == (640, 1280)
    (car,) = segmenter.segment(painted(64, 64, [((16, 12, 48, 40), RED)]))
    assert car.bbox == (16.0, 12.0, 32.0, 28.0)


def test_no_pixel_belongs_to_two(tmp_path):
    segmenter = load_segmenter(colour_network(tmp_path / "net.onnx"), PLAIN)
    image = painted(SIDE, SIDE, [((0, 0, 40, 64), RED), ((28, 20, 60, 64), BLUE)])
    masks = [i.mask for i in segmenter.segment(cv2.blur(image, (5, 5)))]
    assert len(masks) == 2
    assert not (masks[0] & masks[1]).any()


def test_what_scores_too_little_or_is_too_small_is_left_out(tmp_path):
    image = painted(SIDE, SIDE, [((16, 12, 48, 40), RED)])
    faint = colour_network(tmp_path / "faint.onnx", score=0.25)
    assert load_segmenter(faint, PLAIN).segment(image) == []
    path = colour_network(tmp_path / "net.onnx")
    assert load_segmenter(path, SegmenterConfig(min_area_px=2000)).segment(image) == []
    assert load_segmenter(path, PLAIN).segment(np.zeros((1, 1, 3), np.uint8)) == []


def test_a_network_of_no_known_layout_is_named_with_its_shapes(tmp_path):
    mask_rcnn = [(100, 4), (100,), (100,), (100, 1, 28, 28)]
    of_another_size = [(1, 8, 90), (1, 2, 16, 16)]
    detector = [(1, cells(SIDE, SIDE) * 3, 85)]
    said = (r"YOLOv5-seg.*YOLOv8-seg.*adapter", r"YOLOv5-seg.*YOLOv8-seg.*adapter", "without masks")
    for number, (shapes, match) in enumerate(zip([mask_rcnn, of_another_size, detector], said, strict=True)):
        path = other_network(tmp_path / f"{number}.onnx", shapes)
        with pytest.raises(ModelError, match=match) as caught:
            load_segmenter(path)
        assert str(shapes[0]) in str(caught.value)
        assert str(path) in str(caught.value)


def test_inputs_that_are_no_image_are_named(tmp_path):
    for shape in [(1, 10), (4, 3, SIDE, SIDE), (1, 1, SIDE, SIDE)]:
        path = other_network(tmp_path / "net.onnx", [(1, 2, 3)], shape)
        with pytest.raises(ModelError, match="expected"):
            load_segmenter(path)


def test_files_that_are_no_model_are_named(tmp_path):
    (tmp_path / "text.onnx").write_text("not a model")
    (tmp_path / "empty.onnx").write_bytes(b"")
    for name in ("nothing.onnx", "text.onnx", "empty.onnx"):
        with pytest.raises(ModelError, match=name):
            load_segmenter(tmp_path / name)


def test_class_names_come_from_the_metadata(tmp_path):
    listed = colour_network(tmp_path / "list.onnx", names="['car', 'van']")
    assert load_segmenter(listed).names == ("car", "van")
    for names in (None, "{0: 'car'}", "car, truck", "{0: 'car', 1: 'car'}", "{0: 'car', 1: 7}"):
        with pytest.raises(ModelError, match="names"):
            load_segmenter(colour_network(tmp_path / "net.onnx", names=names))


def test_the_coco_names_are_eighty():
    assert len(COCO_CLASSES) == len(set(COCO_CLASSES)) == 80
    assert [COCO_CLASSES[i] for i in (0, 2, 5, 7, 9, 79)] == [
        "person", "car", "bus", "truck", "traffic light", "toothbrush",
    ]  # fmt: skip


@pytest.mark.data
def test_a_real_frame_has_its_cars_whatever_the_threads(data_folder):
    model = data_folder / "models" / "yolov5n-seg.onnx"
    drive = data_folder / "kitti_raw/2011_09_26/2011_09_26_drive_0048_sync"
    image = cv2.imread(str(drive / "image_02/data/0000000000.png"))
    seen = []
    written = [
        write_detections(detect([(0, image)], load_segmenter(model, threads=threads), seen.append))
        for threads in (1, 2)
    ]
    assert written[0] == written[1]
    assert seen == [0, 0]
    segmenter = load_segmenter(model)
    assert set(segmenter.names) == set(COCO_CLASSES)
    cars = [d for d in detect([(0, image)], segmenter).detections if d.category == "car" and d.bbox[2] > 40]
    assert len(cars) >= 4
    left, right = (sum(d.mask()[250, x] for d in cars) for x in (130, 1000))  # two that are close, and the road
    road = sum(d.mask()[330, 600] for d in cars)
    assert (left, right, road) == (1, 1, 0)
