"""Whether a network divides its input by 255 itself: read from the first steps of its graph, without its weights.

ONNX files are protocol buffers. Only the few fields that are needed are read, in place; what cannot be read says
nothing.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from pathlib import Path

LARGE = 20.0  # a divisor, or a mean, of values from 0 to 255 (deviations are near 57); of 0 to 1 it is below 1
_GRAPH, _NODE, _INITIALIZER = 7, 1, 5  # of ModelProto and GraphProto
_MOST_NODES = 8  # the first steps
_PASSED_ON = ("Cast", "Transpose", "Identity", "Unsqueeze", "Squeeze", "Reshape", "Gather", "Resize", "Pad")
_LARGEST_TENSOR = 4096  # bytes: constants of a step are small

Span = tuple[int, int]  # of the file


def expects_bytes(path: Path, input_name: str) -> bool:
    """Whether the first arithmetic on the input is one for values from 0 to 255."""
    try:
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            return _expects_bytes(data, input_name)
    except (OSError, ValueError, IndexError, struct.error):
        return False


def _expects_bytes(data: mmap.mmap, input_name: str) -> bool:
    graph = next((span for number, span in _spans(data, (0, len(data))) if number == _GRAPH), (0, 0))
    nodes: list[Node] = []
    constants: dict[str, list[float]] = {}
    for number, span in _spans(data, graph):
        if number == _NODE and len(nodes) < 10 * _MOST_NODES:
            nodes.append(_node(data, span))
        elif number == _INITIALIZER and span[1] - span[0] < _LARGEST_TENSOR:
            name, values = _tensor(data, span)
            constants[name] = values
    for kind, _, outputs, value in nodes:
        if kind == "Constant" and outputs:
            constants[outputs[0]] = value
    return _is_for_bytes(nodes, constants, input_name)


Node = tuple[str, list[str], list[str], list[float]]  # kind, inputs, outputs, value of a Constant


def _is_for_bytes(nodes: list[Node], constants: dict[str, list[float]], at: str) -> bool:
    """Follow the input to its first arithmetic."""
    for _ in range(_MOST_NODES):
        found = next((node for node in nodes if at in node[1]), None)
        if found is None:
            return False
        kind, inputs, outputs, _ = found
        if kind in _PASSED_ON:
            at = outputs[0]
            continue
        values = [abs(v) for name in inputs if name != at for v in constants.get(name, [])]
        if not values:
            return False
        return (kind in ("Div", "Sub") and min(values) > LARGE) or (kind == "Mul" and 0 < max(values) < 1 / LARGE)
    return False


def _spans(data: mmap.mmap, span: Span) -> Iterator[tuple[int, Span]]:
    """Field numbers of a message with the spans of their content; those of fixed size are passed over."""
    at, end = span
    while at < end:
        key, at = _varint(data, at)
        kind = key & 7
        if kind == 0:
            _, at = _varint(data, at)
        elif kind in (1, 5):
            yield key >> 3, (at, at + (8 if kind == 1 else 4))
            at += 8 if kind == 1 else 4
        elif kind == 2:
            size, at = _varint(data, at)
            if at + size > end:
                raise ValueError("cut")
            yield key >> 3, (at, at + size)
            at += size
        else:
            raise ValueError("no ONNX")


def _varint(data: mmap.mmap, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = data[at]
        value |= (byte & 127) << shift
        at, shift = at + 1, shift + 7
        if byte < 128 or shift > 63:
            return value, at


def _node(data: mmap.mmap, span: Span) -> Node:
    kind = ""
    inputs: list[str] = []
    outputs: list[str] = []
    value: list[float] = []
    for number, (start, end) in _spans(data, span):
        if number in (1, 2, 4):
            text = data[start:end].decode("utf-8", "replace")
            if number == 4:
                kind = text
            else:
                (inputs if number == 1 else outputs).append(text)
        elif number == 5 and end - start < _LARGEST_TENSOR:  # attributes: a Constant's is a tensor
            for part, inner in _spans(data, (start, end)):
                if part == 5:
                    value = _tensor(data, inner)[1]
    return kind, inputs, outputs, value


def _tensor(data: mmap.mmap, span: Span) -> tuple[str, list[float]]:
    """Name and values of a small tensor of float32; other types have none."""
    name, raw, is_float = "", b"", False
    values: list[float] = []
    at, end = span
    for number, (start, stop) in _spans(data, span):
        if number == 8:
            name = data[start:stop].decode("utf-8", "replace")
        elif number == 9:
            raw = data[start:stop]
        elif number == 4:
            values += struct.unpack(f"<{(stop - start) // 4}f", data[start:stop])
    while at < end:  # the type is a plain number, which `_spans` passes over
        key, at = _varint(data, at)
        if key & 7 == 0:
            number_value, at = _varint(data, at)
            is_float |= key >> 3 == 2 and number_value == 1
        elif key & 7 == 2:
            size, at = _varint(data, at)
            at += size
        else:
            at += 8 if key & 7 == 1 else 4
    if not is_float:
        return name, []
    return name, values or list(struct.unpack(f"<{len(raw) // 4}f", raw[: len(raw) // 4 * 4]))
