"""Adapters: small YAML files that say what a network expects and how its outputs are read (docs/networks.md)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, get_args

from meshslam.errors import ModelError, SequenceError
from meshslam.perception.coco import COCO_CLASSES, COCO_NUMBERS
from meshslam.perception.json_values import is_name, quoted
from meshslam.perception.masks import is_finite_number
from meshslam.perception.network_output import Background, BoxFormat, MaskKind, Part, ScoreKind, Table
from meshslam.perception.preprocessing import Fit, Preprocessing
from meshslam.sequences import parsed_yaml

SUFFIX = ".adapter.yaml"
LARGEST_BYTES = 10**6
LARGEST_SIDE_PX = 8192
_SCALES = {"0-1": 1.0, "0-255": 255.0}
_NAMED = {"coco-80": dict(enumerate(COCO_CLASSES)), "coco-91": dict(COCO_NUMBERS)}
_PART = ("output", "columns", "transposed")


@dataclass(frozen=True)
class Adapter:
    """What a file says of a network; None and what is not in `given` follow from the network itself."""

    path: Path
    given: Mapping[str, Any] = field(default_factory=dict)  # fields of Preprocessing
    table: Table | None = None
    classes: Mapping[int, str] | None = None  # by number, as the network counts them

    def preprocessing(self, usual: Preprocessing) -> Preprocessing:
        """What the network expects: as usual, unless the file says otherwise."""
        return replace(usual, **self.given)


def adapter_beside(network: Path) -> Path:
    """Where a network's adapter lies: `net.adapter.yaml` beside `net.onnx`."""
    return network.with_name(f"{network.stem}{SUFFIX}")


def read_adapter(path: Path) -> Adapter:
    """Read an adapter; ModelError names the key that is wrong, what was found and what is expected."""
    root = _Part(path, "", _loaded(path))
    root.only("input", "outputs", "classes")
    if not root.values:
        raise ModelError(f"{path}: says nothing: expected input, outputs or classes")
    outputs = root.part("outputs")
    classes = _classes(root)
    table = None if outputs is None else _table(outputs)
    if table is not None and classes is None:
        raise ModelError(f"{path}: classes: is missing, expected a list of names, or coco-80 or coco-91")
    return Adapter(path, _input(root.part("input")), table, classes)


def _loaded(path: Path) -> object:
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise ModelError(f"{path}: is larger than {LARGEST_BYTES // 10**6} MB: expected an adapter (YAML)")
        return parsed_yaml(path, path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise ModelError(f"{path}: is no text, expected an adapter (YAML)") from None
    except SequenceError as error:
        raise ModelError(str(error)[:300]) from None


class _Part:
    """A mapping of the file, with its place in messages."""

    def __init__(self, path: Path, name: str, values: object) -> None:
        self.path, self.name = path, name
        if not isinstance(values, dict):
            raise self.wrong("", values, "keys with values")
        self.values: dict[object, Any] = values

    def wrong(self, key: str, found: object, expected: str) -> ModelError:
        """The error for a value."""
        place = ".".join(part for part in (self.name, key) if part)
        return ModelError(
            f"{self.path}: {place + ': ' if place else ''}found {quoted(found)}, expected {expected}"[:300]
        )

    def only(self, *keys: str) -> None:
        """Refuse keys that are not known."""
        for key in self.values:
            if key not in keys:
                where = f" in {self.name}" if self.name else ""
                raise ModelError(f"{self.path}: unknown key {quoted(key)}{where}: known are {', '.join(keys)}"[:300])

    def part(self, key: str) -> _Part | None:
        """The mapping under a key, if it is there."""
        place = f"{self.name}.{key}" if self.name else key
        return _Part(self.path, place, self.values[key]) if key in self.values else None

    def word(self, key: str, choices: tuple[str, ...]) -> str | None:
        """One of some words."""
        value = self.values.get(key)
        if value is not None and value not in choices:
            raise self.wrong(key, value, f"one of {', '.join(choices)}")
        return value

    def text(self, key: str) -> str:
        """A name that has to be there."""
        value = self.values.get(key)
        if not is_name(value) or not value:
            raise self.wrong(key, value, "a name")
        return str(value)

    def flag(self, key: str) -> bool:
        """True or false."""
        value = self.values.get(key, False)
        if not isinstance(value, bool):
            raise self.wrong(key, value, "true or false")
        return value

    def integers(self, key: str, count: int, low: int, high: int) -> tuple[int, ...] | None:
        """A list of whole numbers in a range."""
        value = self.values.get(key)
        if value is None:
            return None
        if (
            not isinstance(value, list)
            or len(value) != count
            or not all(type(v) is int and low <= v <= high for v in value)
        ):
            raise self.wrong(key, value, f"{count} whole numbers from {low} to {high}")
        return tuple(value)

    def numbers(self, key: str, *, positive: bool = False) -> tuple[float, ...] | None:
        """Three numbers, one a channel."""
        value = self.values.get(key)
        if value is None:
            return None
        right = isinstance(value, list) and len(value) == 3 and all(is_finite_number(v) for v in value)
        if not right or (positive and min(value) <= 0):
            raise self.wrong(key, value, f"three numbers{' above 0' if positive else ''}, one a channel")
        return tuple(float(v) for v in value)


def _input(part: _Part | None) -> dict[str, Any]:
    """The fields of Preprocessing that are said."""
    if part is None:
        return {}
    part.only("size", "scale", "mean", "std", "channels", "fit", "antialias", "fill")
    scale, fill = part.word("scale", tuple(_SCALES)), part.values.get("fill")
    if fill is not None and (type(fill) is not int or not 0 <= fill <= 255):
        raise part.wrong("fill", fill, "a grey value from 0 to 255")
    said = {
        "size": part.integers("size", 2, 1, LARGEST_SIDE_PX),
        "white": None if scale is None else _SCALES[scale],
        "mean": part.numbers("mean"),
        "std": part.numbers("std", positive=True),
        "channels": part.word("channels", ("rgb", "bgr")),
        "fit": part.word("fit", get_args(Fit)),
        "antialias": part.flag("antialias") if "antialias" in part.values else None,
        "fill": fill,
    }
    return {key: value for key, value in said.items() if value is not None}


def _table(part: _Part) -> Table:
    part.only("boxes", "scores", "labels", "masks", "coefficients")
    boxes, scores, masks = (_needed(part, key) for key in ("boxes", "scores", "masks"))
    labels, coefficients = part.part("labels"), part.part("coefficients")
    boxes.only(*_PART, "format", "normalised")
    scores.only(*_PART, "kind", "background")
    masks.only("output", "kind", "values")
    kind = masks.word("kind", get_args(MaskKind)) or "full"
    if (kind == "prototypes") != (coefficients is not None):
        raise ModelError(
            f"{part.path}: outputs.coefficients: expected with masks of the kind prototypes, and only there"
        )
    first = 0
    if labels is not None:
        labels.only(*_PART, "first")
        first = _first(labels)
    if coefficients is not None:
        coefficients.only(*_PART)
    return Table(
        name=str(part.path.name),
        boxes=_place(boxes),
        scores=_place(scores),
        masks=Part(masks.text("output")),
        labels=None if labels is None else _place(labels),
        first_label=first,
        coefficients=None if coefficients is None else _place(coefficients),
        box_format=boxes.word("format", get_args(BoxFormat)) or "xyxy",  # type: ignore[arg-type] # one of them
        normalised=boxes.flag("normalised"),
        score_kind=scores.word("kind", get_args(ScoreKind)) or "probabilities",  # type: ignore[arg-type]
        background=scores.word("background", get_args(Background)) or "none",  # type: ignore[arg-type]
        mask_kind=kind,  # type: ignore[arg-type]
        mask_logits=masks.word("values", ("logits", "probabilities")) != "probabilities",
    )


def _needed(part: _Part, key: str) -> _Part:
    found = part.part(key)
    if found is None:
        raise ModelError(f"{part.path}: outputs.{key}: is missing, expected the name of its output and what it holds")
    return found


def _first(labels: _Part) -> int:
    value = labels.values.get("first", 0)
    if type(value) is not int or not 0 <= value <= 1000:
        raise labels.wrong("first", value, "the number of the first class, such as 0 or 1")
    return value


def _place(part: _Part) -> Part:
    columns = part.integers("columns", 2, 0, 10**6)
    if columns is not None and columns[0] >= columns[1]:
        raise part.wrong("columns", list(columns), "from and to (excluded), counted from 0")
    return Part(part.text("output"), None if columns is None else (columns[0], columns[1]), part.flag("transposed"))


def _classes(root: _Part) -> dict[int, str] | None:
    value = root.values.get("classes")
    if value is None:
        return None
    if isinstance(value, str) and value in _NAMED:
        return dict(_NAMED[value])
    names = dict(enumerate(value)) if isinstance(value, list) else value
    right = isinstance(names, dict) and names and all(type(n) is int and 0 <= n < 10**6 for n in names)
    if not right or not all(is_name(name) and name for name in names.values()):
        raise root.wrong("classes", value, "a list of names, numbers with names, coco-80 or coco-91")
    return dict(sorted(names.items()))
