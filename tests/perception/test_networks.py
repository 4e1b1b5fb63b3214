"""Networks of many makers: small files with the names, shapes and metadata of real exports."""

import re
from pathlib import Path

import numpy as np
import pytest
from onnx import TensorProto

from meshslam.errors import ModelError
from meshslam.perception import SegmenterConfig, load_segmenter
from meshslam.perception.adapter import read_adapter
from meshslam.perception.letterbox import Letterbox
from meshslam.perception.network_range import expects_bytes
from meshslam.perception.preprocessing import RF_DETR, Preprocessing
from tests.perception.networks import SIDE, colour_network, listing_network, other_network

RED, BLUE = (0, 0, 255), (255, 0, 0)  # BGR
PLAIN = SegmenterConfig(zoom=1.0, min_area_px=20)
COLOURS = [[1, -1, -1, -0.5], [-1, -1, 1, -0.5]]  # logits of red and blue, RGB from 0 to 1
IMAGENET = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])
ULTRALYTICS = {  # as version 8.4.190 writes them
    "description": "Ultralytics YOLO26n-seg model",
    "author": "Ultralytics",
    "version": "8.4.190",
    "stride": "32",
    "task": "segment",
    "batch": "1",
    "imgsz": "[64, 64]",
    "names": "{0: 'car', 1: 'person'}",
    "channels": "3",
}
RAW, END2END, EMBEDDED = (
    {**ULTRALYTICS, "args": str({"batch": 1, "nms": nms, "dynamic": False}), "end2end": end2end}
    for nms, end2end in ((None, "False"), (False, "True"), (True, "False"))
)


def painted(height, width):
    """A red and a blue object, and their boxes."""
    image = np.zeros((height, width, 3), np.uint8)
    boxes = [(width // 8, height // 4, width // 2, height // 2), (width * 5 // 8, height // 2, width, height)]
    for (x0, y0, x1, y1), colour in zip(boxes, (RED, BLUE), strict=True):
        image[y0:y1, x0:x1] = colour
    return image, boxes


def check(segmenter, height=128, width=128, slack=4.0, names=("car", "person")):
    image, boxes = painted(height, width)
    found = segmenter.segment(image)
    assert [i.name for i in found] == list(names)
    for instance, box in zip(found, boxes, strict=True):
        x, y, w, h = instance.bbox
        assert np.abs(np.array([x, y, x + w, y + h]) - box).max() <= slack * max(height, width) / SIDE
        centre = np.argwhere(instance.mask).mean(0)[::-1] + 0.5
        np.testing.assert_allclose(centre, np.reshape(box, (2, 2)).mean(0), atol=max(height, width) / SIDE)
    return found


def finished(path, metadata, size=(SIDE, SIDE), columns=38, **options):
    """300 rows of x0, y0, x1, y1, score, class and 32 coefficients, of which two are answers and the others zeros."""
    rows = np.zeros((1, 300, columns), np.float32)
    for k in (0, 1):
        rows[0, k, :6] = [0, 0, *(size or (320, 320))[::-1], 0.9 - 0.1 * k, k]
        rows[0, k, 6 + k] = 10
    mix = np.zeros((columns - 6, 4), np.float32)
    mix[:2] = COLOURS
    return listing_network(path, {"output0": rows}, "output1", metadata, size, mix, **options)


@pytest.mark.parametrize("metadata", [END2END, EMBEDDED], ids=["end2end", "embedded NMS"])
def test_finished_rows_are_read_whatever_suppressed_them(tmp_path, metadata):
    segmenter = load_segmenter(finished(tmp_path / "net.onnx", metadata), PLAIN)
    assert segmenter.layout.name == "finished YOLO rows"
    assert segmenter.notes == ()
    found = check(segmenter, 96, 128)
    assert [i.score for i in found] == pytest.approx([0.9, 0.8], abs=1e-4)


def test_finished_rows_of_one_class_are_not_taken_for_rows_of_yolov5(tmp_path):
    """38 columns are 5 + 1 + 32, too: 300 rows are no grid's, and metadata tell where sizes are open."""
    one = {**EMBEDDED, "names": "{0: 'car'}", "imgsz": "[160, 160]"}
    for size in ((SIDE, SIDE), None):
        path = finished(tmp_path / "net.onnx", one, size)
        assert load_segmenter(path, PLAIN).layout.kind == "rows"
    v5 = {"stride": "32", "names": "{0: 'car'}"}
    shapes = [(1, 252, 38), (1, 32, 16, 16)]
    segmenter = load_segmenter(other_network(tmp_path / "v5.onnx", shapes, metadata=v5))
    assert (segmenter.layout.kind, segmenter.layout.classes) == ("objectness", 1)


def test_the_same_network_exported_raw_is_a_table(tmp_path):
    path = colour_network(tmp_path / "net.onnx", names=None, metadata=RAW)
    segmenter = load_segmenter(path, PLAIN)
    assert segmenter.layout.kind == "columns"
    check(segmenter, 64, 64)


@pytest.mark.parametrize("metadata", [{**END2END, "imgsz": "[160, 160]"}, {"names": ULTRALYTICS["names"]}])
def test_networks_of_open_size_that_choose_their_best_300_are_never_run_on_small_inputs(tmp_path, metadata):
    path = finished(tmp_path / "net.onnx", metadata, None, inner=("output0", 300))
    segmenter = load_segmenter(path, PLAIN)
    assert segmenter.layout.kind == "rows"
    check(segmenter, 320, 320, slack=1.0)
    with pytest.raises(ModelError, match=r"fails on an input of \(1, 3, 64, 64\)"):
        segmenter.segment(painted(64, 64)[0])


def rf_detr(path, classes=91, number=3):
    """As version 1.11 exports its smallest network: 100 queries, and no metadata."""
    side, (mean, std) = 312, IMAGENET
    boxes, labels = np.full((1, 100, 4), 0.5, np.float32), np.full((1, 100, classes), -8, np.float32)
    boxes[0, :2] = [0.5, 0.5, 1, 1]
    labels[0, 0, number], labels[0, 1, min(1, classes - 1)] = 2.0, 1.0
    labels[0, 2, 0 if classes == 91 else 2] = 9.0  # a number without a class
    mix = np.zeros((100, 4), np.float32)
    for row, colour in enumerate(COLOURS):  # of values less their mean, over their deviation
        mix[row, :3] = colour[:3] * std
        mix[row, 3] = colour[3] + np.dot(colour[:3], mean)
    return listing_network(path, {"dets": boxes, "labels": labels}, "masks", None, (side, side), mix)


@pytest.mark.parametrize(("height", "width"), [(128, 128), (96, 312), (375, 1242)])
def test_rf_detr_is_told_by_its_outputs(tmp_path, height, width):
    segmenter = load_segmenter(rf_detr(tmp_path / "net.onnx"), PLAIN)
    found = check(segmenter, height, width, slack=1.5)
    assert [i.score for i in found] == pytest.approx([1 / (1 + np.exp(-2)), 1 / (1 + np.exp(-1))], abs=1e-3)
    assert len(segmenter.names) == 80
    (note,) = segmenter.notes
    assert "read as RF-DETR" in note
    assert "0.485" in note


def test_rf_detr_sees_the_middle_larger(tmp_path):
    segmenter = load_segmenter(rf_detr(tmp_path / "net.onnx"), SegmenterConfig(min_area_px=20))
    assert len(segmenter._windows(375, 1242)) == 2
    check(segmenter, 375, 1242, slack=1.5)


def test_rf_detr_of_own_classes_needs_their_names(tmp_path):
    path = rf_detr(tmp_path / "net.onnx", classes=3, number=0)
    with pytest.raises(ModelError, match="has 3 classes and does not name them"):
        load_segmenter(path)
    (tmp_path / "net.adapter.yaml").write_text("classes: [car, person]\n")
    check(load_segmenter(path, PLAIN))


def mask_rcnn(path, size=(SIDE, SIDE)):
    """As torchvision's exports: no names that tell, labels by COCO's numbers, probabilities over the input."""
    boxes = np.tile(np.array([0, 0, *size[::-1]], np.float32), (2, 1))
    outputs = {
        "boxes.55": boxes,
        "onnx::Shape_2525": np.array([3, 1], np.int64),
        "2524": np.array([0.9, 0.8], np.float32),
    }
    mix = [[*c[:3], c[3] + 0.5] for c in COLOURS]
    return listing_network(path, outputs, "3122", None, size, mix, cell=1, squeeze=True)


def test_mask_rcnn_of_a_fixed_size_gets_images_of_that_size(tmp_path):
    segmenter = load_segmenter(mask_rcnn(tmp_path / "net.onnx"), PLAIN)
    check(segmenter, 96, 128)
    assert "64x64 px only" in segmenter.notes[0]


def test_bytes_in_are_0_to_255(tmp_path):
    rows_of_bytes = [[c / 255 for c in row[:3]] + row[3:] for row in COLOURS]
    rows = np.zeros((1, 300, 8), np.float32)
    for k in (0, 1):
        rows[0, k, :6] = [0, 0, SIDE, SIDE, 0.9 - 0.1 * k, k]
        rows[0, k, 6 + k] = 10
    path = listing_network(
        tmp_path / "net.onnx", {"output0": rows}, "output1", END2END, mix=rows_of_bytes, dtype=TensorProto.UINT8
    )
    check(load_segmenter(path, PLAIN))


CHANNELS = (1, 3, 1, 1)
FIRST_STEPS = {
    "a division": (("Div", 255.0), True),
    "a factor": (("Mul", 1 / 255), True),
    "means of 0 to 255": (("Sub", np.reshape([123.7, 116.3, 103.5], CHANNELS)), True),
    "means of 0 to 1": (("Sub", np.reshape(IMAGENET[0], CHANNELS)), False),
    "deviations of 0 to 1": (("Div", np.reshape(IMAGENET[1], CHANNELS)), False),
    "another factor": (("Mul", 2.0), False),
}


@pytest.mark.parametrize("name", FIRST_STEPS)
def test_the_first_step_tells_whether_0_to_255_is_expected(tmp_path, name):
    step, is_bytes = FIRST_STEPS[name]
    segmenter = load_segmenter(finished(tmp_path / "net.onnx", END2END, step=step), PLAIN)
    assert segmenter.kind.expected.white == (255 if is_bytes else 1)
    assert any("from 0 to 255" in note for note in segmenter.notes) == is_bytes
    if name == "a division":
        check(segmenter)
    (tmp_path / "net.adapter.yaml").write_text("input: {scale: 0-1}\n")
    assert load_segmenter(tmp_path / "net.onnx").kind.expected.white == 1


def test_a_file_that_is_no_onnx_says_nothing_of_its_first_step(tmp_path):
    whole = finished(tmp_path / "net.onnx", END2END, step=("Div", 255.0)).read_bytes()
    assert expects_bytes(tmp_path / "net.onnx", "images")
    for content in (b"", b"x", whole[:100], whole[: len(whole) // 2], bytes(range(256)) * 8):
        (tmp_path / "cut.onnx").write_bytes(content)
        assert not expects_bytes(tmp_path / "cut.onnx", "images")


def test_a_class_without_a_name_is_an_error_and_not_left_out(tmp_path):
    path = finished(tmp_path / "net.onnx", {**END2END, "names": "{0: 'car'}"})
    with pytest.raises(ModelError, match=r"says class 1, but 1 have names"):
        load_segmenter(path, PLAIN).segment(painted(64, 64)[0])


def test_what_is_assumed_is_said(tmp_path):
    told = load_segmenter(finished(tmp_path / "told.onnx", END2END))
    bare = load_segmenter(finished(tmp_path / "bare.onnx", {}))
    assert told.notes == ()
    assert ["RGB from 0 to 1, letterboxed" in bare.notes[0], "COCO's 80 names" in bare.notes[1]] == [True, True]
    assert len(bare.names) == 80


# ---- adapters

ADAPTER = """
input: {scale: 0-255, channels: bgr, fit: letterbox, fill: 0}
outputs:
  boxes: {output: where, format: xyxy}
  scores: {output: what, kind: softmax, background: last}
  masks: {output: shape, kind: full, values: logits}
classes: [person, car]
"""


def own_network(
    path, boxes=((0, 0, SIDE, SIDE), (0, 0, SIDE, SIDE)), scores=None, size=(SIDE, SIDE), bgr=True, white=255
):
    """Two answers: a car in red and a person in blue; scores are logits with the background last."""
    scores = [[-2, 3, -2], [2.5, -2, -2]] if scores is None else scores
    outputs = {"where": np.array([boxes], np.float32), "what": np.array([scores], np.float32)}
    mix = [[v / white for v in (row[:3][::-1] if bgr else row[:3])] + row[3:] for row in COLOURS]
    return listing_network(path, outputs, "shape", None, size, mix)


def test_an_adapter_tells_what_a_network_of_any_maker_expects_and_says(tmp_path):
    path = own_network(tmp_path / "net.onnx")
    with pytest.raises(ModelError, match="adapter"):
        load_segmenter(path, PLAIN)
    (tmp_path / "net.adapter.yaml").write_text(ADAPTER)
    found = check(load_segmenter(path, PLAIN), 96, 128)
    assert [i.score for i in found] == pytest.approx(
        [np.exp(5) / (np.exp(5) + 2), np.exp(4.5) / (np.exp(4.5) + 2)], abs=1e-3
    )


@pytest.mark.parametrize(
    ("boxes", "said"),
    [
        ((32, 32, 64, 64), "format: cxcywh"),
        ((0, 0, 64, 64), "format: xywh"),
        ((0.5, 0.5, 1, 1), "format: cxcywh, normalised: true"),
        ((0, 0, 1, 1), "format: xyxy, normalised: true"),
    ],
)
def test_boxes_of_every_kind(tmp_path, boxes, said):
    path = own_network(tmp_path / "net.onnx", (boxes, boxes))
    (tmp_path / "a.yaml").write_text(ADAPTER.replace("format: xyxy", said))
    check(load_segmenter(path, PLAIN, adapter=tmp_path / "a.yaml"))


@pytest.mark.parametrize(
    ("scores", "said"),
    [
        ([[0.1, 0.9], [0.8, 0.1]], "kind: probabilities"),
        ([[-3, 3], [2, -3]], "kind: logits"),
        ([[0, 0.1, 0.9], [0, 0.8, 0.1]], "kind: probabilities, background: first"),
        ([[0, -3, 3], [9, 2, -3]], "kind: logits, background: first"),
    ],
)
def test_scores_of_every_kind(tmp_path, scores, said):
    path = own_network(tmp_path / "net.onnx", scores=scores)
    (tmp_path / "a.yaml").write_text(ADAPTER.replace("kind: softmax, background: last", said))
    check(load_segmenter(path, PLAIN, adapter=tmp_path / "a.yaml"))


def test_images_that_are_stretched_come_back_as_they_were(tmp_path):
    path = own_network(tmp_path / "net.onnx")
    (tmp_path / "a.yaml").write_text(ADAPTER.replace("letterbox", "stretch"))
    check(load_segmenter(path, PLAIN, adapter=tmp_path / "a.yaml"), 64, 256, slack=2.5)


def test_what_becomes_smaller_is_averaged_unless_the_network_was_trained_otherwise():
    fine = np.zeros((64, 64, 3), np.uint8)
    fine[:, ::4] = 255
    whole = (0, 0, 64, 64)
    averaged, picked = (
        Letterbox.fit(whole, 16, 16, "stretch").image_to_input(fine, Preprocessing(antialias=a)) for a in (True, False)
    )
    assert np.ptp(averaged) < 0.02
    assert averaged.mean() == pytest.approx(0.25, abs=0.02)
    assert picked.max() == 0
    assert not RF_DETR.antialias


def test_mean_deviation_and_size_are_the_adapters(tmp_path):
    path = own_network(tmp_path / "net.onnx", ((0, 0, 160, 160),) * 2, size=None, bgr=False, white=1)
    text = ADAPTER.replace("scale: 0-255, channels: bgr", "size: [160, 160], mean: [0, 0, 0], std: [1, 1, 1]")
    (tmp_path / "a.yaml").write_text(text)
    check(load_segmenter(path, PLAIN, adapter=tmp_path / "a.yaml"))
    for other in ("mean: [1, 0, 0]", "std: [4, 1, 1]"):  # red is no longer seen
        (tmp_path / "a.yaml").write_text(text.replace("mean: [0, 0, 0], std: [1, 1, 1]", other))
        found = load_segmenter(path, PLAIN, adapter=tmp_path / "a.yaml").segment(painted(128, 128)[0])
        assert "car" not in [i.name for i in found if i.bbox[0] < 60]
    (tmp_path / "a.yaml").write_text(text.replace("size: [160, 160], ", ""))
    with pytest.raises(ModelError, match=r"input\.size: is missing"):
        load_segmenter(path, PLAIN, adapter=tmp_path / "a.yaml")


def test_masks_in_boxes_with_labels(tmp_path):
    """Each box is half of the image; its mask is a third of the box."""
    grids = np.full((1, 2, 9, 9), 0.1, np.float32)
    grids[0, :, 3:6, 3:6] = 0.9
    outputs = {
        "where": np.array([[[0, 0, 32, 64], [32, 0, 64, 64]]], np.float32),
        "score": np.array([[0.9, 0.8]], np.float32),
        "label": np.array([[2, 1]], np.int64),
        "grid": grids,
    }
    path = listing_network(tmp_path / "net.onnx", outputs, "unused", mix=COLOURS)
    (tmp_path / "net.adapter.yaml").write_text(
        "outputs:\n  boxes: {output: where}\n  scores: {output: score}\n  labels: {output: label, first: 1}\n"
        "  masks: {output: grid, kind: box, values: probabilities}\nclasses: [person, car]\n"
    )
    car, person = load_segmenter(path, PLAIN).segment(np.zeros((64, 64, 3), np.uint8))
    assert (car.name, person.name) == ("car", "person")
    assert car.bbox == pytest.approx((32 / 3, 64 / 3, 32 / 3, 64 / 3), abs=1.5)
    assert person.bbox == pytest.approx((32 + 32 / 3, 64 / 3, 32 / 3, 64 / 3), abs=1.5)


def test_a_table_in_columns_with_prototypes(tmp_path):
    """As a YOLO's raw table, told part by part."""
    path = colour_network(tmp_path / "net.onnx", names=None)
    (tmp_path / "net.adapter.yaml").write_text(
        "outputs:\n  boxes: {output: output0, columns: [0, 4], transposed: true, format: cxcywh}\n"
        "  scores: {output: output0, columns: [4, 6], transposed: true}\n"
        "  coefficients: {output: output0, columns: [6, 8], transposed: true}\n"
        "  masks: {output: output1, kind: prototypes}\nclasses: [car, person]\n"
    )
    check(load_segmenter(path, PLAIN), 64, 64)


def test_an_adapter_of_classes_and_input_alone_changes_what_is_told(tmp_path):
    path = colour_network(tmp_path / "net.onnx")
    (tmp_path / "net.adapter.yaml").write_text("classes: [van, human]\ninput: {channels: bgr}\n")
    segmenter = load_segmenter(path, PLAIN)
    found = segmenter.segment(painted(64, 64)[0])
    assert [(i.name, i.bbox[0] > 30) for i in found] == [("van", True), ("human", False)]
    (tmp_path / "net.adapter.yaml").write_text("classes: [van]\n")
    with pytest.raises(ModelError, match="found 1 names, the network has 2 classes"):
        load_segmenter(path)


def test_the_adapter_of_the_documentation_is_one(tmp_path):
    page = (Path(__file__).resolve().parents[2] / "docs" / "networks.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    (tmp_path / "net.adapter.yaml").write_text(block)
    found = read_adapter(tmp_path / "net.adapter.yaml")
    assert found.classes == {0: "person", 1: "car"}
    assert (found.table.box_format, found.table.score_kind, found.table.background) == ("cxcywh", "softmax", "last")
    assert found.preprocessing(Preprocessing()).std == (0.229, 0.224, 0.225)


WRONG = {
    "unknown key": ("inputs: {}", 'unknown key "inputs": known are input, outputs, classes'),
    "unknown key inside": (ADAPTER.replace("fill", "fills"), 'unknown key "fills" in input'),
    "no such output": (ADAPTER.replace("where", "boxes"), "found 'boxes', the network's are where, what, shape"),
    "a word that is none": (ADAPTER.replace("xyxy", "yxyx"), 'outputs.boxes.format: found "yxyx", expected one of'),
    "no classes": (ADAPTER.replace("classes: [person, car]", ""), "classes: is missing"),
    "too many classes": (ADAPTER.replace("[person, car]", "[a, b, c]"), "scores: output 'what' has shape (2, 3)"),
    "no masks": (
        ADAPTER.replace("  masks: {output: shape, kind: full, values: logits}\n", ""),
        "outputs.masks: is missing",
    ),
    "prototypes without coefficients": (ADAPTER.replace("full", "prototypes"), "outputs.coefficients: expected with"),
    "a mean of one channel": (ADAPTER.replace("fill: 0", "mean: [3]"), "input.mean: found [3], expected three numbers"),
    "a size that is none": (ADAPTER.replace("fill: 0", "size: 640"), "input.size: found 640"),
    "a flag that is none": (
        ADAPTER.replace("fill: 0", "antialias: 2"),
        "input.antialias: found 2, expected true or false",
    ),
    "a wrong scale": (ADAPTER.replace("0-255", "255"), "input.scale: found 255, expected one of 0-1, 0-255"),
    "no YAML": ("input: [", "not valid YAML"),
    "a list": ("- input", "expected keys with values"),
    "nothing": ("", "expected keys with values"),
    "masks for boxes": (ADAPTER.replace("output: where", "output: shape"), "boxes: output 'shape' has shape"),
}


@pytest.mark.parametrize("name", WRONG)
def test_adapters_that_are_wrong_are_named_in_one_line(tmp_path, name):
    text, said = WRONG[name]
    path = own_network(tmp_path / "net.onnx")
    (tmp_path / "net.adapter.yaml").write_text(text)
    with pytest.raises(ModelError) as caught:
        load_segmenter(path, PLAIN).segment(painted(64, 64)[0])
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value).replace(str(tmp_path), "")) <= 300


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("yolo11n-seg.pt", "yolo export model=yolo11n-seg.pt format=onnx"),
        ("best.pth", "RFDETRSegNano(pretrain_weights='best.pth').export()"),
        ("net.engine", "is no ONNX file"),
    ],
)
def test_weights_of_other_formats_come_with_the_way_to_onnx(tmp_path, name, said):
    for is_there in (False, True):
        if is_there:
            (tmp_path / name).write_bytes(b"PK")
        with pytest.raises(ModelError) as caught:
            load_segmenter(tmp_path / name)
        assert said in str(caught.value)


# ---- what classes are called


def test_classes_are_renamed_and_usual_names_are_guessed(tmp_path):
    path = colour_network(tmp_path / "net.onnx", names="{0: 'Vehicle', 1: 'person'}")
    assert load_segmenter(path).names == ("Vehicle", "person")
    guessed = load_segmenter(path, PLAIN, renamed={})
    assert guessed.names == ("car", "person")
    assert any("is taken for car" in note for note in guessed.notes)
    told = load_segmenter(path, PLAIN, renamed={"vehicle": "bus", "person": "bus"})
    assert told.names == ("bus",)
    assert [i.name for i in told.segment(painted(64, 64)[0])] == ["bus"]  # of one class now, in one box
    with pytest.raises(ModelError, match=r'no class "vehicel", there are Vehicle, person'):
        load_segmenter(path, renamed={"vehicel": "car"})
