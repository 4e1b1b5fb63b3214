"""Networks for instance segmentation in an ONNX Runtime session: two looks at an image."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from meshslam.errors import ModelError
from meshslam.geometry import AnyArray, Bytes, Floats
from meshslam.perception import yolo
from meshslam.perception.adapter import Adapter
from meshslam.perception.candidates import Candidates
from meshslam.perception.coco import VEHICLES, association_group
from meshslam.perception.instances import Instance, SegmenterConfig, settled
from meshslam.perception.letterbox import Letterbox
from meshslam.perception.network_classes import used_names
from meshslam.perception.network_kinds import kind_of
from meshslam.perception.network_output import Table
from meshslam.perception.network_session import NetworkSession
from meshslam.perception.suppression import Patch, suppress_boxes

Window = tuple[int, int, int, int]  # x0, y0, x1, y1: px


class NetworkSegmenter:
    """A network that lists candidates with masks for an input of fixed, or of open size."""

    keypoint_names: tuple[str, ...] = ()

    def __init__(
        self,
        session: NetworkSession,
        config: SegmenterConfig,
        adapter: Adapter | None = None,
        renamed: Mapping[str, str] | None = None,
        tracked: Collection[str] = VEHICLES,
    ) -> None:
        self.path, self.config, self._session = session.path, config, session
        self.kind = kind_of(session, adapter)
        names, notes = used_names(self.path, self.kind.names.values(), renamed, tracked)
        self._names = [names[name] for name in self.kind.names.values()]
        self.names = tuple(dict.fromkeys(self._names))
        self.notes = (*self.kind.notes, *notes)
        self._static = session.static or self.kind.expected.size
        self._groups = np.array([association_group(name) for name in self._names], dtype=object)

    @property
    def layout(self) -> yolo.Layout | Table:
        """How the outputs are read."""
        return self.kind.layout

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
        names = [self._names[i] for i in classes[best]]
        return settled(patches, scores[best], names, image_bgr.shape[:2], self.config)

    def _windows(self, height: int, width: int) -> list[Window]:
        whole: Window = (0, 0, width, height)
        rows, columns = self._input_size(height, width)
        scale = self.config.zoom * Letterbox.fit(whole, rows, columns).scale[0]
        w, h = min(width, round(columns / scale)), min(height, round(rows / scale))
        if self.config.zoom <= 1 or (w, h) == (width, height):
            return [whole]
        x, y = (width - w) // 2, (height - h) // 2
        return [whole, (x, y, x + w, y + h)]

    def _look(self, image_bgr: Bytes, window: Window) -> StartFrame:
        height, width = image_bgr.shape[:2]
        letterbox = Letterbox.fit(window, *self._input_size(height, width), self.kind.expected.fit)
        outputs = self._session.run(letterbox.image_to_input(image_bgr, self.kind.expected))
        size = (letterbox.height, letterbox.width)
        self._check(outputs, size)
        try:
            candidates = self.kind.decode(outputs, self._session, size, self.config.score_threshold)
        except ModelError as error:
            raise ModelError(f"{self.path}: {error}") from None
        boxes = letterbox.boxes_to_image(candidates.boxes)
        usable = _uncut(boxes, window, height, width) & (boxes[:, 2:] - boxes[:, :2] >= 1).all(1)
        return StartFrame(letterbox, candidates.subset(usable), boxes[usable])

    def _check(self, outputs: Sequence[AnyArray], size: tuple[int, int]) -> None:
        """ModelError where the outputs for an input of `size` are not those of the layout."""
        if not isinstance(self.kind.layout, yolo.Layout):
            return
        try:
            found = yolo.recognize([output.shape for output in outputs], size, self._session.metadata)
        except ModelError as error:
            raise ModelError(f"{self.path}: {error}") from None
        if found != self.kind.layout:
            raise ModelError(f"{self.path}: its outputs change from {self.kind.layout} to {found}"[:300])

    def _input_size(self, height: int, width: int) -> tuple[int, int]:
        if self._static:
            return self._static
        scale = min(1.0, self.config.max_side_px / max(height, width))
        return _up_to_stride(height * scale), _up_to_stride(width * scale)


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
        masks = self.candidates.masks
        extent = masks.extent(row)
        across, down = (None, None) if extent is None else ((extent[0], extent[2]), (extent[1], extent[3]))
        rows, vertical = self.letterbox.interpolation(1, y0, max(y1, y0 + 1), masks.grid[0], down)
        columns, horizontal = self.letterbox.interpolation(0, x0, max(x1, x0 + 1), masks.grid[1], across)
        coarse = masks.logits(row, rows, columns)
        logits = vertical @ coarse @ horizontal.T
        return Patch(x0, y0, np.asarray(logits, np.float32))


def _uncut(boxes: Floats, window: Window, height: int, width: int, margin_px: float = 3.0) -> AnyArray:
    """Tell which boxes are not cut by a window's border (the image's own border cuts what it cuts)."""
    x0, y0, x1, y1 = window
    borders = [(x0, 0), (y0, 0), (x1, width), (y1, height)]
    cut = [np.abs(boxes[:, i] - at) < margin_px for i, (at, end) in enumerate(borders) if at != end]
    return ~np.any(cut, axis=0) if cut else np.ones(len(boxes), bool)


def _up_to_stride(length: float) -> int:
    return max(32, int(np.ceil(length / 32)) * 32)
