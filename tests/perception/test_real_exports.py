"""Exports of the networks' own makers, with random weights: names, shapes and open sizes are theirs.

Needs torchvision, ultralytics and rfdetr, which no extra installs; `pip install torchvision ultralytics rfdetr onnx`.
"""

import numpy as np
import pytest

from meshslam.perception import SegmenterConfig, load_segmenter
from meshslam.perception.coco import COCO_CLASSES

CAR = 3  # of COCO's 91 numbers


@pytest.fixture(scope="module")
def image():
    rng = np.random.default_rng(0)
    return np.kron(rng.integers(0, 256, (6, 10, 3)), np.ones((20, 24, 1))).astype(np.uint8)


@pytest.fixture(scope="module")
def mask_rcnn():
    """A small Mask R-CNN that takes almost everything for a car."""
    torch = pytest.importorskip("torch")
    detection = pytest.importorskip("torchvision").models.detection
    torch.manual_seed(0)
    network = detection.maskrcnn_resnet50_fpn(
        weights=None, weights_backbone=None, num_classes=91, min_size=96, max_size=192, rpn_post_nms_top_n_test=20
    )
    box, mask = network.roi_heads.box_predictor.cls_score, network.roi_heads.mask_predictor.mask_fcn_logits
    with torch.no_grad():
        for layer, index, bias in ((box, CAR, 8.0), (mask, CAR, 2.0)):
            layer.weight *= 1e-3 / layer.weight.abs().max()
            layer.bias[index] += bias
    return network.eval()


@pytest.mark.filterwarnings("ignore")  # of the exporter
def test_mask_rcnn_by_torchvision(mask_rcnn, image, tmp_path):
    torch = pytest.importorskip("torch")
    path = tmp_path / "mask_rcnn.onnx"
    example = torch.rand(3, 90, 160)
    torch.onnx.export(
        mask_rcnn,
        ([example],),
        str(path),
        input_names=["image"],
        output_names=["boxes", "labels", "scores", "masks"],
        dynamic_axes={"image": {1: "height", 2: "width"}},
        opset_version=17,
        dynamo=False,
    )
    segmenter = load_segmenter(path, SegmenterConfig(min_area_px=1))
    found = segmenter.segment(image)
    with torch.no_grad():
        (own,) = mask_rcnn([torch.from_numpy(image[..., ::-1].transpose(2, 0, 1) / np.float32(255))])
    sure = own["scores"].numpy() >= 0.3
    theirs = own["masks"].numpy()[sure][:, 0] > 0.5
    assert len(theirs) > 3
    assert found
    assert {i.name for i in found} == {"car"}
    for instance in found:  # no pixel belongs to two: each has its own part of one of theirs
        mask = instance.mask.astype(bool)
        outside = (mask & ~theirs).sum((1, 2)) / mask.sum()
        assert outside.min() < 0.01
    covered, wanted = np.any([i.mask > 0 for i in found], axis=0), theirs.any(0)
    assert (covered & wanted).sum() > 0.8 * wanted.sum()


@pytest.mark.filterwarnings("ignore")
def test_mask_rcnn_of_a_fixed_size(mask_rcnn, image, tmp_path):
    """Exported without names and open sizes, by the exporter that works (dynamo=False)."""
    torch = pytest.importorskip("torch")
    path = tmp_path / "fixed.onnx"
    torch.onnx.export(mask_rcnn, ([torch.rand(3, 90, 160)],), str(path), dynamo=False)
    segmenter = load_segmenter(path, SegmenterConfig(min_area_px=1, zoom=1.0))
    assert segmenter.kind.name == "Mask R-CNN"
    found = segmenter.segment(image)
    assert {i.name for i in found} == {"car"}


@pytest.mark.filterwarnings("ignore")
def test_rf_detr(image, tmp_path):
    """Masks are those of the network's own postprocessing."""
    torch, rfdetr = pytest.importorskip("torch"), pytest.importorskip("rfdetr")
    torch.manual_seed(0)
    network = rfdetr.RFDETRSegNano(pretrain_weights=None)
    network.export(output_dir=str(tmp_path), verbose=False)
    (path,) = tmp_path.glob("*.onnx")
    segmenter = load_segmenter(path, SegmenterConfig(score_threshold=0.0, min_area_px=1, zoom=1.0))
    assert segmenter.kind.name == "RF-DETR"
    assert segmenter.names == COCO_CLASSES
    assert segmenter.segment(image)
    look = segmenter._look(image, (0, 0, image.shape[1], image.shape[0]))
    theirs = network.predict(image[..., ::-1].copy(), threshold=0.0)
    own = look.candidates.scores.argmax()  # of a class with a name
    named = np.isin(theirs.class_id, list(segmenter.kind.names))
    nearest = np.abs(theirs.xyxy[named] - look.boxes_in_image[own]).max(1).argmin()
    np.testing.assert_allclose(theirs.xyxy[named][nearest], look.boxes_in_image[own], atol=0.5)
    assert theirs.confidence[named].max() == pytest.approx(look.candidates.scores[own], abs=1e-3)
    patch = look.patch(own)
    mask = np.zeros(image.shape[:2], bool)
    mask[patch.place] = patch.inside
    box = np.zeros_like(mask)
    box[patch.place] = True
    assert (mask != (theirs.mask[named][nearest] & box)).mean() < 0.01


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("nms", [False, True])
@pytest.mark.parametrize("dynamic", [False, True])
def test_finished_rows_by_ultralytics(nms, dynamic, image, tmp_path, monkeypatch):
    torch, ultralytics = pytest.importorskip("torch"), pytest.importorskip("ultralytics")
    monkeypatch.chdir(tmp_path)
    torch.manual_seed(0)
    network = ultralytics.YOLO("yolo26n-seg.yaml")
    path = network.export(format="onnx", imgsz=(160, 320), nms=nms, dynamic=dynamic, simplify=False)
    segmenter = load_segmenter(path, SegmenterConfig(score_threshold=0.0, min_area_px=1, zoom=1.0))
    assert segmenter.layout.kind == "rows"
    segmenter.segment(np.kron(image, np.ones((4, 2, 1), np.uint8)))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["yolov8n-seg.yaml", "yolo11n-seg.yaml", "yolo26n-seg.yaml"])
@pytest.mark.parametrize("dynamic", [False, True])
def test_yolo_by_ultralytics(name, dynamic, image, tmp_path, monkeypatch):
    torch, ultralytics = pytest.importorskip("torch"), pytest.importorskip("ultralytics")
    monkeypatch.chdir(tmp_path)
    torch.manual_seed(0)
    network = ultralytics.YOLO(name)
    network.model.names = dict(enumerate(COCO_CLASSES))
    path = network.export(format="onnx", imgsz=(96, 160), dynamic=dynamic, simplify=False)
    segmenter = load_segmenter(path, SegmenterConfig(score_threshold=0.0, min_area_px=1, zoom=1.0))
    assert segmenter.layout.name == "YOLOv8-seg"
    assert segmenter.layout.classes == len(segmenter.names) == 80
    assert segmenter.names == COCO_CLASSES
    assert segmenter.segment(image)
