"""Mask R-CNN (He et al. 2017) in an ONNX Runtime session: torchvision's exports, and those of the ONNX model zoo."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from meshslam.errors import ModelError
from meshslam.geometry import AnyArray, Bytes, Floats, Singles
from meshslam.perception.coco import COCO_CLASSES, COCO_NUMBERS, VEHICLES, association_group
from meshslam.perception.instances import Instance, SegmenterConfig, first_line, settled
from meshslam.perception.network_classes import used_names
from meshslam.perception.suppression import Patch, suppress_boxes

CELLS = 28  # of a mask that is not pasted into the image yet
_ZOO_MEAN_BGR = np.array([102.9801, 115.9465, 122.7717], np.float32)
_ZOO_SHORTER_PX = 800
_STRIDE = 32


@dataclass(frozen=True)
class MaskRcnnLayout:
    """Which outputs are which, and what the network expects.

    `pasted`: masks have the input's size, and the input is RGB in [0, 1] (torchvision); else they are `CELLS` wide in
    their boxes, and the input is BGR less its mean, padded to a multiple of 32 (the model zoo).
    """

    boxes: int
    labels: int
    scores: int
    masks: int
    pasted: bool

    def names(self) -> dict[int, str]:
        """Classes by label."""
        return dict(COCO_NUMBERS) if self.pasted else dict(enumerate(COCO_CLASSES, start=1))


def recognize_mask_rcnn(session: Any) -> MaskRcnnLayout | None:  # noqa: ANN401 # untyped package
    """The layout of outputs boxes (N, 4), labels (N), scores (N), masks (N, 1, h, w); None for others."""
    outputs, place = session.get_outputs(), {}
    for i, output in enumerate(outputs):
        rank = len(output.shape)
        kind = {2: "boxes", 4: "masks"}.get(rank, "labels" if "int" in output.type else "scores")
        place[kind] = i
    if len(outputs) != 4 or set(place) != {"boxes", "labels", "scores", "masks"}:
        return None
    return MaskRcnnLayout(**place, pasted=outputs[place["masks"]].shape[-1] != CELLS)


def has_open_size(session: Any) -> bool:  # noqa: ANN401 # untyped package
    """Whether a network takes images of any size."""
    sizes = session.get_inputs()[0].shape[-2:]
    return not all(isinstance(size, int) for size in sizes)


def input_of(image_bgr: Bytes, layout: MaskRcnnLayout, rank: int) -> tuple[Singles, float]:
    """The input (3, h, w), or (1, 3, h, w) for rank 4, and how much larger it is than the image."""
    if layout.pasted:
        values, scale = image_bgr[..., ::-1].astype(np.float32) / np.float32(255), 1.0
    else:
        scale = _ZOO_SHORTER_PX / min(image_bgr.shape[:2])
        larger = cv2.resize(image_bgr, None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR)
        height, width = (-(-n // _STRIDE) * _STRIDE for n in larger.shape[:2])
        values = np.zeros((height, width, 3), np.float32)
        values[: larger.shape[0], : larger.shape[1]] = larger.astype(np.float32) - _ZOO_MEAN_BGR
    planes = np.ascontiguousarray(values.transpose(2, 0, 1), np.float32)
    return (planes if rank == 3 else planes[None]), scale


def decode_mask_rcnn(
    outputs: Sequence[AnyArray], layout: MaskRcnnLayout, scale: float, height: int, width: int, least_score: float
) -> tuple[Floats, Floats, list[int], list[Patch]]:
    """Boxes (N, 4) x0, y0, x1, y1 in the image, scores (N,), labels and masks of what scores enough and is known."""
    known = layout.names()
    scores, labels = np.asarray(outputs[layout.scores], float), [int(v) for v in outputs[layout.labels]]
    boxes = np.clip(np.asarray(outputs[layout.boxes], float) / scale, 0, [width, height, width, height])
    large = np.all(boxes[:, 2:] - boxes[:, :2] >= 1, axis=1)
    rows = [i for i in range(len(scores)) if scores[i] >= least_score and labels[i] in known and large[i]]
    patches = [_patch(np.asarray(outputs[layout.masks][i, 0], np.float32), boxes[i], layout) for i in rows]
    return boxes[rows], scores[rows], [labels[i] for i in rows], patches


def _patch(mask: Singles, box: Floats, layout: MaskRcnnLayout) -> Patch:
    """Probabilities over one half, cut at the box."""
    x0, y0 = np.floor(box[:2]).astype(int).tolist()
    x1, y1 = np.ceil(box[2:]).astype(int).tolist()
    if layout.pasted:
        return Patch(x0, y0, mask[y0:y1, x0:x1] - np.float32(0.5))
    part = cv2.resize(mask, (x1 - x0, y1 - y0), interpolation=cv2.INTER_LINEAR)
    return Patch(x0, y0, np.asarray(part, np.float32) - np.float32(0.5))


class MaskRcnnSegmenter:
    """A Mask R-CNN in an ONNX Runtime session."""

    keypoint_names: tuple[str, ...] = ()

    def __init__(
        self,
        path: Path,
        session: Any,  # noqa: ANN401 # untyped package
        layout: MaskRcnnLayout,
        config: SegmenterConfig,
        renamed: Mapping[str, str] | None = None,
        tracked: Collection[str] = VEHICLES,
    ) -> None:
        self.path, self.config, self.layout, self._session = path, config, layout, session
        inputs = session.get_inputs()
        if len(inputs) != 1 or len(inputs[0].shape) not in (3, 4) or inputs[0].type != "tensor(float)":
            found = ", ".join(f"{i.name} {i.shape} {i.type}" for i in inputs)
            raise ModelError(f"{path}: has inputs {found}, expected one float image (3, height, width)")
        self._input, self._rank = inputs[0].name, len(inputs[0].shape)
        names, notes = used_names(path, layout.names().values(), renamed, tracked)
        self._known = {label: names[name] for label, name in layout.names().items()}
        self.names = tuple(dict.fromkeys(self._known.values()))
        expected = "RGB from 0 to 1" if layout.pasted else f"BGR less its mean, the shorter side {_ZOO_SHORTER_PX} px"
        said = (
            f"{path}: has no metadata: read as Mask R-CNN by its outputs: {len(self._known)} COCO classes, {expected}"
        )
        self.notes = (said, *notes)

    def segment(self, image_bgr: Bytes) -> list[Instance]:
        """Return the instances in a (height, width, 3) image by falling score; no pixel belongs to two."""
        values, scale = input_of(image_bgr, self.layout, self._rank)
        try:
            outputs = self._session.run(None, {self._input: values})
        except Exception as error:  # the runtime's own exceptions have no common base but this
            raise ModelError(f"{self.path}: fails on an input of {values.shape}: {first_line(error)}") from None
        height, width = image_bgr.shape[:2]
        found = decode_mask_rcnn(outputs, self.layout, scale, height, width, self.config.score_threshold)
        boxes, scores, labels, patches = found
        names = [self._known[label] for label in labels]
        groups = np.array([association_group(name) for name in names], dtype=object)
        best = suppress_boxes(boxes, scores, groups, self.config.iou_threshold)[: self.config.max_instances]
        chosen = [patches[i] for i in best]
        return settled(chosen, scores[best], [names[i] for i in best], (height, width), self.config)
