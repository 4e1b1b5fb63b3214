"""A segmentation network in an ONNX Runtime session: its one image input, its outputs, what its metadata say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.errors import ModelError
from meshslam.geometry import AnyArray, Singles
from meshslam.perception.instances import first_line
from meshslam.perception.onnx_runtime import inference_session

Dims = tuple[int | None, ...]  # None: open
_TYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16, "tensor(uint8)": np.uint8}
WEIGHTS = {  # files that are no ONNX: how they become it
    ".pt": "`yolo export model={name} format=onnx` (Ultralytics), or `model.export()` of the tool that trained it",
    ".pth": "`RFDETRSegNano(pretrain_weights='{name}').export()` (RF-DETR), or torch.onnx.export(…, dynamo=False)",
}
WEIGHTS |= {".ckpt": WEIGHTS[".pth"]}
_OTHERS = (".engine", ".torchscript", ".tflite", ".pb", ".mlpackage", ".xml", ".safetensors", ".h5", ".keras")
NOT_ONNX = (*WEIGHTS, *_OTHERS)


@dataclass(frozen=True)
class Output:
    """One output as the file declares it."""

    name: str
    dims: Dims


@dataclass(frozen=True, eq=False)
class NetworkSession:
    """A loaded network.

    Its image is (1, 3, h, w); (3, h, w) where it is not `batched`, (1, h, w, 3) where channels come last.
    """

    path: Path
    session: Any
    input_name: str
    dtype: type
    channels_last: bool
    batched: bool
    static: tuple[int, int] | None  # height, width: px; None where the network leaves the size open
    outputs: tuple[Output, ...]
    metadata: dict[str, str]

    def run(self, values: Singles) -> list[AnyArray]:
        """The outputs for an input (1, 3, h, w); ModelError if the network fails on it."""
        ordered = values.transpose(0, 2, 3, 1) if self.channels_last else values
        ordered = ordered if self.batched else ordered[0]
        if self.dtype is np.uint8:
            ordered = np.clip(np.rint(ordered), 0, 255)
        try:
            return list(self.session.run(None, {self.input_name: np.ascontiguousarray(ordered, self.dtype)}))
        except Exception as error:  # the runtime's own exceptions have no common base but this
            raise ModelError(f"{self.path}: fails on an input of {ordered.shape}: {first_line(error)}"[:300]) from None


def open_network(path: Path, threads: int = 2) -> Any:  # noqa: ANN401 # untyped package
    """ONNX Runtime's session of a file; ModelError if it is none, with the way to ONNX where it is a known other."""
    if path.suffix.lower() in NOT_ONNX:
        raise ModelError(not_onnx(path))
    if not path.is_file():
        raise ModelError(f"{path}: no such file, expected an ONNX export of an instance segmentation network")
    try:
        return inference_session(path, threads)
    except Exception as error:  # the runtime's own exceptions have no common base but this
        raise ModelError(f"{path}: cannot be loaded as an ONNX model: {first_line(error)}") from None


def not_onnx(path: Path) -> str:
    """What to do with weights of another format, in one line."""
    way = WEIGHTS.get(path.suffix.lower(), "export the network as ONNX with the tool that trained it")
    return f"{path}: is no ONNX file, which is what runs here: {way.format(name=path.name[:60])}"


def image_session(path: Path, session: Any) -> NetworkSession:  # noqa: ANN401 # untyped package
    """The network with its image input; ModelError if it has another."""
    inputs = session.get_inputs()
    found = ", ".join(f"{i.name} {i.shape} {i.type}" for i in inputs)
    expected = f"{path}: has inputs {found[:120]}, expected one image (1, 3, height, width) of numbers or bytes"
    if len(inputs) != 1 or len(inputs[0].shape) not in (3, 4) or inputs[0].type not in _TYPES:
        raise ModelError(expected)
    batched = len(inputs[0].shape) == 4
    batch, *sizes = inputs[0].shape if batched else (1, *inputs[0].shape)
    last = sizes[2] == 3 and sizes[0] != 3
    if not last and sizes[0] not in (3, "3"):
        raise ModelError(expected)
    if isinstance(batch, int) and batch > 1:
        raise ModelError(f"{path}: has a batch of {batch}, expected 1 or an open size: export it again with batch=1")
    height, width = sizes[:2] if last else sizes[1:]
    static = (height, width) if isinstance(height, int) and isinstance(width, int) and min(height, width) > 0 else None
    outputs = tuple(Output(o.name, _dims(o.shape)) for o in session.get_outputs())
    metadata = dict(session.get_modelmeta().custom_metadata_map)
    dtype = _TYPES[inputs[0].type]
    return NetworkSession(path, session, inputs[0].name, dtype, last, batched, static, outputs, metadata)


def _dims(shape: Sequence[int | str | None]) -> Dims:
    return tuple(n if isinstance(n, int) and n > 0 else None for n in shape)


def shapes_text(shapes: Sequence[Sequence[int | None]]) -> str:
    """Outputs' shapes, as messages name them; open sizes are question marks."""
    return ", ".join(f"({', '.join('?' if n is None else str(n) for n in shape)})" for shape in shapes)[:100]
