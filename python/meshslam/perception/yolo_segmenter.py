"""YOLO networks for instance segmentation in an ONNX Runtime session: two looks at an image."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.errors import ModelError
from meshslam.geometry import AnyArray, Bytes, Floats, Singles
from meshslam.perception.coco import COCO_CLASSES, association_group
from meshslam.perception.instances import Instance, SegmenterConfig, first_line, settled
from meshslam.perception.letterbox import Letterbox
from meshslam.perception.suppression import Patch, suppress_boxes
from meshslam.perception.yolo import Candidates, Layout, decode, recognize

Window = tuple[int, int, int, int]  # x0, y0, x1, y1: px


class YoloSegmenter:
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
        best = best[: self.config.max_instances]
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

    def _look(self, image_bgr: Bytes, window: Window) -> StartFrame:
        height, width = image_bgr.shape[:2]
        letterbox = Letterbox.fit(window, *self._input_size(height, width))
        outputs = self._run(letterbox.image_to_input(image_bgr))
        self._recognize(outputs, letterbox.height, letterbox.width)
        candidates = decode(outputs, self.layout, self.config.score_threshold)
        boxes = letterbox.boxes_to_image(candidates.boxes)
        usable = _uncut(boxes, window, height, width) & (boxes[:, 2:] - boxes[:, :2] >= 1).all(1)
        return StartFrame(letterbox, candidates.subset(usable), boxes[usable])

    def _input_size(self, height: int, width: int) -> tuple[int, int]:
        if self._static:
            return self._static
        scale = min(1.0, self.config.max_side_px / max(height, width))
        return _up_to_stride(height * scale), _up_to_stride(width * scale)

    def _run(self, values: Singles) -> list[AnyArray]:
        try:
            return list(self._session.run(None, {self._input: values.astype(self._dtype)}))
        except Exception as error:  # the runtime's own exceptions have no common base but this
            raise ModelError(f"{self.path}: fails on an input of {values.shape}: {first_line(error)}") from None

    def _recognize(self, outputs: Sequence[AnyArray], height: int, width: int) -> Layout:
        try:
            return recognize([output.shape for output in outputs], height, width)
        except ModelError as error:
            raise ModelError(f"{self.path}: {error}") from None


@dataclass(frozen=True, eq=False)
class StartFrame:
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
