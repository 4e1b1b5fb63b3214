"""Instance segmentation by ONNX Runtime: images in, detections out."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np

from meshslam.errors import ModelError
from meshslam.geometry.arrays import AnyArray, Bools, Bytes, Floats
from meshslam.perception.coco import COCO_CLASSES, VEHICLE_GROUP, association_group
from meshslam.perception.detections import CategoryEntry, Detection, DetectionSet, ImageEntry
from meshslam.perception.letterbox import Letterbox, Singles
from meshslam.perception.mask_rcnn import MaskRcnnLayout, decode_mask_rcnn, input_of, recognize_mask_rcnn
from meshslam.perception.masks import encode_mask
from meshslam.perception.suppression import (
    Patch,
    outline_filled,
    share_out,
    shared_area_px,
    suppress_boxes,
    suppress_nested,
)
from meshslam.perception.yolo import Candidates, Layout, decode, recognize

Window = tuple[int, int, int, int]  # x0, y0, x1, y1: px


@dataclass(frozen=True)
class SegmenterConfig:
    """What is kept of a network's answers."""

    score_threshold: float = 0.3
    iou_threshold: float = 0.6  # boxes of one group that overlap by more are one object
    nested_share: float = 0.75  # a mask with this share in another of its group is the same object
    minimum_area_px: int = 80
    maximum_instances: int = 100
    zoom: float = 2.0  # a second look at the image's middle, enlarged, for what is far away; 1: none
    longest_side_px: int = 1280  # of the input of networks that leave its size open


@dataclass(frozen=True, eq=False)
class Instance:
    """One object in one image."""

    name: str
    score: float
    bbox: tuple[float, float, float, float]  # of the mask: x, y, width, height: px
    mask: Bytes  # (height, width), zeros and ones
    keypoints: Floats | None = None  # (K, 2) px, by those who find them along the way
    keypoint_scores: Floats | None = None  # (K,)
    track_id: int | None = None  # by those who know one object from another


class Segmenter(Protocol):
    """Finds the instances in an image."""

    @property
    def names(self) -> tuple[str, ...]:
        """The classes that can be found."""
        ...

    @property
    def keypoint_names(self) -> tuple[str, ...]:
        """Names of the key points that come with every instance; mostly none do."""
        ...

    def segment(self, image_bgr: Bytes) -> list[Instance]:
        """Return the instances in a (height, width, 3) image by falling score; no pixel belongs to two."""
        ...


def load_segmenter(path: Path, config: SegmenterConfig | None = None, threads: int = 2) -> Segmenter:
    """Load a network for instance segmentation; its layout is told from its outputs' shapes.

    Known are YOLO-seg (v5, v8, 11) and Mask R-CNN (torchvision, ONNX model zoo).

    Raises ModelError if the file cannot be loaded or its inputs, outputs or class names fit no known layout.
    """
    import onnxruntime  # slow to import: only those who segment wait for it

    path = Path(path)
    if not path.is_file():
        raise ModelError(f"{path}: no such file, expected an ONNX export of an instance segmentation network")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    options.log_severity_level = 3
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # spinning threads starve other processes
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # the runtime's own exceptions have no common base but this
        raise ModelError(f"{path}: cannot be loaded as an ONNX model: {_first_line(error)}") from None
    layout = recognize_mask_rcnn(session)
    if layout is not None:
        return MaskRcnnSegmenter(path, session, layout, config or SegmenterConfig())
    return OnnxSegmenter(path, session, config or SegmenterConfig())


class OnnxSegmenter:
    """A YOLO network in an ONNX Runtime session."""

    keypoint_names: tuple[str, ...] = ()

    def __init__(self, path: Path, session: Any, config: SegmenterConfig) -> None:  # noqa: ANN401 # untyped package
        self.path, self.config, self._session = path, config, session
        self._input, self._dtype, self._static = _input_of(path, session)
        height, width = self._static or (64, 64)
        blank = np.zeros((1, 3, height, width), np.float32)
        self.layout = self._recognize(self._run(blank), height, width)
        self.names = _class_names(path, session.get_modelmeta().custom_metadata_map, self.layout.classes)
        self._groups = np.array([association_group(name) for name in self.names])

    def segment(self, image_bgr: Bytes) -> list[Instance]:
        """Return the instances in a (height, width, 3) image by falling score; no pixel belongs to two."""
        looks = [self._look(image_bgr, window) for window in self._windows(*image_bgr.shape[:2])]
        boxes = np.concatenate([look.boxes_in_image for look in looks])
        scores = np.concatenate([look.candidates.scores for look in looks])
        classes = np.concatenate([look.candidates.classes for look in looks])
        places = [(look, row) for look in looks for row in range(len(look.candidates.scores))]
        best = suppress_boxes(boxes, scores, self._groups[classes], self.config.iou_threshold)
        best = best[: self.config.maximum_instances]
        patches = [places[i][0].patch(places[i][1]) for i in best]
        names = [self.names[i] for i in classes[best]]
        return settled(patches, scores[best], names, image_bgr.shape[:2], self.config)

    def _windows(self, height: int, width: int) -> list[Window]:
        whole: Window = (0, 0, width, height)
        rows, columns = self._input_size(height, width)
        scale = self.config.zoom * Letterbox.fit(whole, rows, columns).scale
        w, h = min(width, round(columns / scale)), min(height, round(rows / scale))
        if self.config.zoom <= 1 or (w, h) == (width, height):
            return [whole]
        x, y = (width - w) // 2, (height - h) // 2
        return [whole, (x, y, x + w, y + h)]

    def _look(self, image_bgr: Bytes, window: Window) -> Look:
        height, width = image_bgr.shape[:2]
        letterbox = Letterbox.fit(window, *self._input_size(height, width))
        outputs = self._run(letterbox.image_to_input(image_bgr))
        self._recognize(outputs, letterbox.height, letterbox.width)
        candidates = decode(outputs, self.layout, self.config.score_threshold)
        boxes = letterbox.boxes_to_image(candidates.boxes)
        usable = _uncut(boxes, window, height, width) & (boxes[:, 2:] - boxes[:, :2] >= 1).all(1)
        return Look(letterbox, candidates.subset(usable), boxes[usable])

    def _input_size(self, height: int, width: int) -> tuple[int, int]:
        if self._static:
            return self._static
        scale = min(1.0, self.config.longest_side_px / max(height, width))
        return _up_to_stride(height * scale), _up_to_stride(width * scale)

    def _run(self, values: Singles) -> list[AnyArray]:
        try:
            return list(self._session.run(None, {self._input: values.astype(self._dtype)}))
        except Exception as error:  # the runtime's own exceptions have no common base but this
            raise ModelError(f"{self.path}: fails on an input of {values.shape}: {_first_line(error)}") from None

    def _recognize(self, outputs: Sequence[AnyArray], height: int, width: int) -> Layout:
        try:
            return recognize([output.shape for output in outputs], height, width)
        except ModelError as error:
            raise ModelError(f"{self.path}: {error}") from None


class MaskRcnnSegmenter:
    """A Mask R-CNN in an ONNX Runtime session."""

    keypoint_names: tuple[str, ...] = ()

    def __init__(self, path: Path, session: Any, layout: MaskRcnnLayout, config: SegmenterConfig) -> None:  # noqa: ANN401 # untyped package
        self.path, self.config, self.layout, self._session = path, config, layout, session
        inputs = session.get_inputs()
        if len(inputs) != 1 or len(inputs[0].shape) not in (3, 4) or inputs[0].type != "tensor(float)":
            found = ", ".join(f"{i.name} {i.shape} {i.type}" for i in inputs)
            raise ModelError(f"{path}: has inputs {found}, expected one float image (3, height, width)")
        self._input, self._rank = inputs[0].name, len(inputs[0].shape)
        self.names = tuple(dict.fromkeys(layout.names().values()))

    def segment(self, image_bgr: Bytes) -> list[Instance]:
        """Return the instances in a (height, width, 3) image by falling score; no pixel belongs to two."""
        values, scale = input_of(image_bgr, self.layout, self._rank)
        try:
            outputs = self._session.run(None, {self._input: values})
        except Exception as error:  # the runtime's own exceptions have no common base but this
            raise ModelError(f"{self.path}: fails on an input of {values.shape}: {_first_line(error)}") from None
        height, width = image_bgr.shape[:2]
        found = decode_mask_rcnn(outputs, self.layout, scale, height, width, self.config.score_threshold)
        boxes, scores, labels, patches = found
        known = self.layout.names()
        names = [known[label] for label in labels]
        groups = np.array([association_group(name) for name in names], dtype=object)
        best = suppress_boxes(boxes, scores, groups, self.config.iou_threshold)[: self.config.maximum_instances]
        chosen = [patches[i] for i in best]
        return settled(chosen, scores[best], [names[i] for i in best], (height, width), self.config)


def settled(
    patches: Sequence[Patch], scores: Floats, names: Sequence[str], image_size: tuple[int, int], config: SegmenterConfig
) -> list[Instance]:
    """Instances of candidates by falling score: nested ones and passengers left out, each pixel given to one."""
    groups = np.array([association_group(name) for name in names])
    kept = suppress_nested(patches, groups, config.nested_share)
    kept = without_passengers(kept, patches, groups == VEHICLE_GROUP)
    masks = share_out([patches[k] for k in kept], [bool(groups[k] == VEHICLE_GROUP) for k in kept], *image_size)
    found = []
    for k, part in zip(kept, masks, strict=True):
        if int(part.sum()) < config.minimum_area_px:
            continue
        x, y, width, height = cv2.boundingRect(part)
        mask = np.zeros(image_size, np.uint8)
        mask[patches[k].place] = part
        bbox = (float(x + patches[k].left), float(y + patches[k].top), float(width), float(height))
        found.append(Instance(names[k], round(float(scores[k]), 4), bbox, mask))
    return found


@dataclass(frozen=True, eq=False)
class Look:
    """What the network said of one window of an image."""

    letterbox: Letterbox
    candidates: Candidates
    boxes_in_image: Floats  # (N, 4) x0, y0, x1, y1

    def patch(self, row: int) -> Patch:
        """Mask logits of one candidate, cut at its box."""
        x0, y0 = np.floor(self.boxes_in_image[row, :2]).astype(int).tolist()
        x1, y1 = np.ceil(self.boxes_in_image[row, 2:]).astype(int).tolist()
        prototypes = self.candidates.prototypes
        rows, vertical = self.letterbox.interpolation(1, y0, max(y1, y0 + 1), prototypes.shape[1])
        columns, horizontal = self.letterbox.interpolation(0, x0, max(x1, x0 + 1), prototypes.shape[2])
        coefficients = self.candidates.coefficients[row].astype(np.float32)
        coarse = np.tensordot(coefficients, prototypes[:, rows, columns], 1)
        return Patch(x0, y0, vertical @ coarse @ horizontal.T)


def detect(
    frames: Iterable[tuple[int, Bytes]],
    segmenter: Segmenter,
    progress: Callable[[int], None] | None = None,
    file_name: Callable[[int], str] = "{:06d}.png".format,
) -> DetectionSet:
    """Segment (frame number, BGR image) pairs.

    `progress` is called with each frame's number when it is done; `file_name` tells what the file of a frame is called.
    """
    numbers = {name: i + 1 for i, name in enumerate(segmenter.names)}
    images: list[ImageEntry] = []
    detections: list[Detection] = []
    for frame, image in frames:
        height, width = image.shape[:2]
        images.append(ImageEntry(frame, file_name(frame), width, height))
        for instance in segmenter.segment(image):
            detections.append(_detection(len(detections) + 1, frame, instance, (height, width)))
        if progress:
            progress(frame)
    points = segmenter.keypoint_names
    categories = tuple(CategoryEntry(number, name, points) for name, number in numbers.items())
    return DetectionSet(tuple(images), categories, tuple(detections))


def _detection(number: int, frame: int, instance: Instance, image_size: tuple[int, int]) -> Detection:
    code = encode_mask(instance.mask)
    found = Detection(number, frame, instance.name, instance.score, instance.bbox, code, image_size)
    points, scores, track = instance.keypoints, instance.keypoint_scores, instance.track_id
    return replace(found, keypoints=points, keypoint_scores=scores, track_id=track)


def without_passengers(kept: Sequence[int], patches: Sequence[Patch], vehicle: Bools, share: float = 0.9) -> list[int]:
    """Drop of the `kept` patches those enclosed by a vehicle's outline: a driver leaves no hole in the car."""
    outlines = [
        Patch(v.left, v.top, outline_filled(v.inside.astype(np.uint8)).astype(np.float32))
        for v in (patches[k] for k in kept if vehicle[k])
    ]

    def enclosed(patch: Patch) -> bool:
        area = int(patch.inside.sum())
        return any(shared_area_px(patch, outline) >= share * area for outline in outlines)

    return [k for k in kept if vehicle[k] or not enclosed(patches[k])]


def _uncut(boxes: Floats, window: Window, height: int, width: int, margin_px: float = 3.0) -> AnyArray:
    """Tell which boxes are not cut by a window's border (the image's own border cuts what it cuts)."""
    x0, y0, x1, y1 = window
    borders = [(x0, 0), (y0, 0), (x1, width), (y1, height)]
    cut = [np.abs(boxes[:, i] - at) < margin_px for i, (at, end) in enumerate(borders) if at != end]
    return ~np.any(cut, axis=0) if cut else np.ones(len(boxes), bool)


def _up_to_stride(length: float) -> int:
    return max(32, int(np.ceil(length / 32)) * 32)


def _input_of(path: Path, session: Any) -> tuple[str, type, tuple[int, int] | None]:  # noqa: ANN401 # untyped package
    """Name, type and (height, width) of the one image input; None where the network leaves the size open."""
    inputs = session.get_inputs()
    types = {"tensor(float)": np.float32, "tensor(float16)": np.float16}
    found = ", ".join(f"{i.name} {i.shape} {i.type}" for i in inputs)
    if (
        len(inputs) != 1
        or len(inputs[0].shape) != 4
        or inputs[0].type not in types
        or inputs[0].shape[1] not in (3, "3")
    ):
        raise ModelError(f"{path}: has inputs {found}, expected one float image (1, 3, height, width)")
    batch, _, height, width = inputs[0].shape
    if isinstance(batch, int) and batch != 1:
        raise ModelError(f"{path}: has a batch of {batch}, expected 1 or an open size: export it again with batch=1")
    static = (height, width) if isinstance(height, int) and isinstance(width, int) else None
    return inputs[0].name, types[inputs[0].type], static


def _class_names(path: Path, metadata: dict[str, str], count: int) -> tuple[str, ...]:
    """Names by class index: the metadata's `names`, COCO's for those that 80-class networks leave out."""
    try:
        given = ast.literal_eval(metadata.get("names", "{}"))
    except (ValueError, SyntaxError):
        raise ModelError(f"{path}: metadata `names` is no dictionary: {metadata['names'][:60]!r}") from None
    given = dict(enumerate(given)) if isinstance(given, list | tuple) else given
    coco = dict(enumerate(COCO_CLASSES)) if count == len(COCO_CLASSES) else {}
    names = coco | given if isinstance(given, dict) else coco
    missing = [i for i in range(count) if not isinstance(names.get(i), str)]
    if missing:
        raise ModelError(f"{path}: metadata `names` has no name for classes {missing[:10]} of {count}")
    chosen = tuple(names[i] for i in range(count))
    if len(set(chosen)) < count:
        raise ModelError(f"{path}: metadata `names` gives one name to two classes: {chosen[:10]}")
    return chosen


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:200]
