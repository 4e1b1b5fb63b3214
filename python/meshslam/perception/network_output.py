"""Outputs of a network that lists its objects: boxes, scores and masks, read as a layout or an adapter says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from meshslam.errors import ModelError
from meshslam.geometry import AnyArray, Floats, Singles
from meshslam.perception.candidates import Candidates, GridMasks, Masks, PrototypeMasks

BoxFormat = Literal["xyxy", "xywh", "cxcywh"]
ScoreKind = Literal["probabilities", "logits", "softmax"]
MaskKind = Literal["full", "box", "prototypes"]
Background = Literal["none", "first", "last"]


@dataclass(frozen=True)
class Part:
    """An output by its name, or some columns of it."""

    output: str
    columns: tuple[int, int] | None = None  # from, to (excluded); counted from 0
    transposed: bool = False  # candidates are in columns

    def of(self, outputs: Mapping[str, AnyArray]) -> AnyArray:
        """Its values without the batch."""
        values = outputs[self.output]
        values = values[0] if values.ndim > 1 and values.shape[0] == 1 else values
        values = values.T if self.transposed else values
        return values if self.columns is None else values[..., slice(*self.columns)]


@dataclass(frozen=True)
class Table:
    """Where the parts of N objects are, and what they mean."""

    name: str
    boxes: Part  # (N, 4)
    scores: Part  # (N, classes), or (N,) with labels
    masks: Part  # (N, h, w), (N, 1, h, w), (N, classes, h, w) in boxes, or prototypes (M, h, w)
    labels: Part | None = None  # (N,): class numbers
    first_label: int = 0  # number of the first class
    coefficients: Part | None = None  # (N, M), with prototypes
    box_format: BoxFormat = "xyxy"
    normalised: bool = False  # to the input's size
    score_kind: ScoreKind = "probabilities"
    background: Background = "none"
    mask_kind: MaskKind = "full"
    mask_logits: bool = True  # else probabilities

    @property
    def parts(self) -> dict[str, Part]:
        """The parts that are there, by key."""
        every = {"boxes": self.boxes, "scores": self.scores, "labels": self.labels, "masks": self.masks}
        every |= {"coefficients": self.coefficients}
        return {key: part for key, part in every.items() if part is not None}


def decode_table(
    outputs: Mapping[str, AnyArray], table: Table, numbers: Sequence[int], size: tuple[int, int], least_score: float
) -> Candidates:
    """Read what scores at least `least_score`, for an input of `size` (height, width).

    `numbers` are the classes' columns, or their labels; what has another is left out. ModelError where the outputs'
    shapes do not go together.
    """
    values = {key: part.of(outputs) for key, part in table.parts.items()}
    _check(values, table, numbers)
    classes, scores = _best(values, table, np.asarray(numbers))
    keep = np.flatnonzero(scores >= least_score)
    boxes = _corners(values["boxes"][keep].astype(float), table, size)
    labels = np.asarray(numbers)[classes[keep]] if len(keep) else np.zeros(0, int)
    return Candidates(boxes, classes[keep], scores[keep], _masks(values, table, keep, boxes, labels))


def _check(values: Mapping[str, AnyArray], table: Table, numbers: Sequence[int]) -> None:
    count = len(values["boxes"]) if values["boxes"].ndim == 2 else -1
    each = [key for key in values if key != "masks" or table.mask_kind != "prototypes"]
    masks = values["masks"]
    ranks = {"boxes": (2,), "labels": (1, 2), "coefficients": (2,), "scores": (1, 2) if "labels" in values else (2,)}
    ranks["masks"] = (3,) if table.mask_kind == "prototypes" else (3, 4)
    for key, part in table.parts.items():
        shape = values[key].shape
        wrong = values[key].ndim not in ranks[key] or (key in each and len(values[key]) != count)
        wrong |= key == "boxes" and shape[-1] != 4
        wrong |= key == "coefficients" and shape[-1] != masks.shape[0]
        if key == "scores" and "labels" not in values and len(numbers) > 0:
            wrong |= shape[-1] - (table.background != "none") <= max(numbers)
        if wrong:
            raise ModelError(f"{table.name}: {key}: output {part.output!r} has shape {shape}, {_expected(key, table)}")


def _expected(key: str, table: Table) -> str:
    masks = "prototypes (1, M, h, w)" if table.mask_kind == "prototypes" else "a mask a row (1, N, h, w)"
    expected = {
        "boxes": "(1, N, 4)",
        "scores": "(1, N, classes), a class for each name" if table.labels is None else "a number a row",
        "labels": "a number a row",
        "masks": masks,
        "coefficients": "(1, N, M), M as the prototypes",
    }
    return f"expected {expected[key]}"


def _best(values: Mapping[str, AnyArray], table: Table, numbers: AnyArray) -> tuple[AnyArray, Floats]:
    """The best class of each row, as an index of `numbers`, and its score."""
    scores = values["scores"].astype(float)
    if "labels" in values:
        labels = values["labels"].reshape(len(scores)).astype(int) - table.first_label
        chances = _probabilities(scores.reshape(len(scores), -1), table.score_kind).max(1)
        index = np.searchsorted(numbers, labels)
        known = np.take(numbers, index, mode="clip") == labels if len(numbers) else np.zeros(len(labels), bool)
        return np.where(known, index, 0), np.where(known, chances, -1.0)
    chances = _probabilities(scores, table.score_kind)
    if table.background != "none":
        chances = chances[:, 1:] if table.background == "first" else chances[:, :-1]
    chosen = chances[:, numbers]
    classes = chosen.argmax(1)
    return classes, np.take_along_axis(chosen, classes[:, None], 1)[:, 0]


def _probabilities(scores: Floats, kind: ScoreKind) -> Floats:
    if kind == "probabilities":
        return scores
    if kind == "logits":
        sigmoid: Floats = 0.5 * (1 + np.tanh(scores / 2))
        return sigmoid
    power = np.exp(scores - scores.max(1, keepdims=True))
    softmax: Floats = power / power.sum(1, keepdims=True)
    return softmax


def _corners(boxes: Floats, table: Table, size: tuple[int, int]) -> Floats:
    """Boxes x0, y0, x1, y1 in pixels of the input."""
    first, second = boxes[:, :2], boxes[:, 2:]
    if table.box_format == "cxcywh":
        first, second = first - second / 2, first + second / 2
    elif table.box_format == "xywh":
        second = first + second
    corners = np.concatenate([first, second], 1)
    return corners * np.tile(size[::-1], 2) if table.normalised else corners


def _masks(values: Mapping[str, AnyArray], table: Table, keep: AnyArray, boxes: Floats, labels: AnyArray) -> Masks:
    if table.mask_kind == "prototypes":
        return PrototypeMasks(values["coefficients"][keep].astype(float), values["masks"].astype(np.float32))
    grids = values["masks"][keep]
    if grids.ndim == 4:  # a mask for each class, or one for all
        several = grids.shape[1] > 1
        grids = grids[np.arange(len(keep)), np.minimum(labels, grids.shape[1] - 1) if several else 0]
    plain: Singles = grids.astype(np.float32)
    return GridMasks(plain, 0.0 if table.mask_logits else 0.5, boxes if table.mask_kind == "box" else None)
