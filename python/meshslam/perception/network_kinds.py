"""Which network a file holds: what tells it, how it is read, what it expects, which classes it has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from meshslam.errors import ModelError
from meshslam.geometry import AnyArray
from meshslam.perception import yolo
from meshslam.perception.adapter import Adapter
from meshslam.perception.candidates import Candidates
from meshslam.perception.mask_rcnn import CELLS, recognize_mask_rcnn
from meshslam.perception.network_classes import names_of_columns, names_of_metadata
from meshslam.perception.network_output import Part, Table, decode_table
from meshslam.perception.network_range import expects_bytes
from meshslam.perception.network_session import NetworkSession, shapes_text
from meshslam.perception.preprocessing import RF_DETR, Preprocessing
from meshslam.perception.rf_detr import recognize_rf_detr

PROBED_PX = (640, 640)  # where neither shapes nor metadata say: networks choose their best 300, which small inputs lack


@dataclass(frozen=True, eq=False)
class NetworkKind:
    """How one network is fed and read."""

    name: str
    layout: yolo.Layout | Table
    names: Mapping[int, str]  # by class number, ascending
    expected: Preprocessing
    notes: tuple[str, ...] = ()

    def decode(
        self, outputs: Sequence[AnyArray], session: NetworkSession, size: tuple[int, int], least_score: float
    ) -> Candidates:
        """What the network says, in pixels of an input of `size` (height, width); classes are indices of `names`."""
        if isinstance(self.layout, Table):
            by_name = {o.name: values for o, values in zip(session.outputs, outputs, strict=True)}
            return decode_table(by_name, self.layout, list(self.names), size, least_score)
        found = yolo.decode(outputs, self.layout, least_score)
        if len(found.classes) and not 0 <= found.classes.min() <= found.classes.max() < len(self.names):
            raise ModelError(
                f"it says class {found.classes.max()}, but {len(self.names)} have names: give `classes` in an adapter"
            )
        return found


def kind_of(session: NetworkSession, adapter: Adapter | None) -> NetworkKind:
    """Tell a network's kind from its adapter, or from its outputs and metadata; ModelError if neither fits."""
    found = _kind(session, adapter)
    if found.expected.white == 255 or (adapter is not None and "white" in adapter.given):
        return found
    if session.dtype is not np.uint8 and not expects_bytes(session.path, session.input_name):
        return found
    note = f"{session.path}: works on values from 0 to 255, by its first step: it gets these"
    return replace(found, expected=replace(found.expected, white=255.0), notes=(*found.notes, note))


def _kind(session: NetworkSession, adapter: Adapter | None) -> NetworkKind:
    if adapter is not None and adapter.table is not None:
        return _adapted(session, adapter, adapter.table)
    listed = recognize_rf_detr(session.outputs)
    found = _pasted(session) if listed is None else _rf_detr(session, listed, adapter)
    found = found or _yolo(session, adapter)
    if adapter is None:
        return found
    names = found.names if adapter.classes is None else adapter.classes
    _check_classes(adapter, found, names)
    return replace(found, names=names, expected=adapter.preprocessing(found.expected), notes=())


def _check_classes(adapter: Adapter, found: NetworkKind, names: Mapping[int, str]) -> None:
    """ModelError unless a YOLO network has a name for each class."""
    if not isinstance(found.layout, yolo.Layout):
        return
    count = found.layout.classes or len(names)
    if list(names) != list(range(count)):
        raise ModelError(
            f"{adapter.path}: classes: found {len(names)} names, the network has {count} classes, from 0 on"
        )


def _adapted(session: NetworkSession, adapter: Adapter, table: Table) -> NetworkKind:
    there = [o.name for o in session.outputs]
    for key, part in table.parts.items():
        if part.output not in there:
            found = f"found {part.output[:40]!r}, the network's are {', '.join(there)}"
            raise ModelError(f"{adapter.path}: outputs.{key}.output: {found}"[:300])
    if session.static is None and "size" not in adapter.given:
        raise ModelError(
            f"{adapter.path}: input.size: is missing, and the network leaves it open: expected [height, width]"
        )
    return NetworkKind("adapter", table, adapter.classes or {}, adapter.preprocessing(Preprocessing()))


def _rf_detr(session: NetworkSession, table: Table, adapter: Adapter | None) -> NetworkKind:
    columns = next(o.dims[2] for o in session.outputs if o.name == table.scores.output)
    own = adapter is not None and adapter.classes is not None
    names = {0: ""} if own else names_of_columns(session.path, columns)
    said = "classes by COCO's numbers" if columns == 91 else f"{columns} classes"
    note = f"{session.path}: has no metadata: read as RF-DETR by its outputs: {said}, {RF_DETR.text()}"
    return NetworkKind(table.name, table, names, RF_DETR, (note,))


def _pasted(session: NetworkSession) -> NetworkKind | None:
    """A Mask R-CNN by torchvision whose input has a fixed size; None for others."""
    layout = recognize_mask_rcnn(session.session)
    if layout is None or session.static is None:
        return None
    if not layout.pasted:
        raise ModelError(f"{session.path}: masks of {CELLS} cells, but an input of fixed size: write an adapter")
    names = [o.name for o in session.outputs]
    table = Table(
        name="Mask R-CNN",
        boxes=Part(names[layout.boxes]),
        scores=Part(names[layout.scores]),
        labels=Part(names[layout.labels]),
        masks=Part(names[layout.masks]),
        mask_logits=False,
    )
    height, width = session.static
    note = f"{session.path}: takes images of {width}x{height} px only: they are scaled to it (open sizes see more)"
    return NetworkKind(table.name, table, layout.names(), Preprocessing(fill=0), (note,))


def _yolo(session: NetworkSession, adapter: Adapter | None) -> NetworkKind:
    try:
        layout = yolo.recognize([o.dims for o in session.outputs], session.static, session.metadata)
        if layout is None:
            layout = _probed(session, adapter)
    except ModelError as error:
        raise ModelError(f"{session.path}: {error}") from None
    own = adapter is not None and adapter.classes is not None
    names = {0: ""} if own else names_of_metadata(session.path, session.metadata, layout.classes)
    usual = Preprocessing()
    told = "stride" in session.metadata or "imgsz" in session.metadata
    notes = (
        f"its metadata do not say what it expects: {usual.text()} (input of an adapter says otherwise)",
        f"its metadata name no classes: COCO's {len(names)} names are used (classes of an adapter give others)",
    )
    assumed = (not told, not own and "names" not in session.metadata)
    said = tuple(f"{session.path}: {note}" for note, is_so in zip(notes, assumed, strict=True) if is_so)
    return NetworkKind(layout.name, layout, names, usual, said)


def _probed(session: NetworkSession, adapter: Adapter | None) -> yolo.Layout:
    """The layout by the outputs for a blank image, of the size that the network was exported for."""
    said = None if adapter is None else adapter.given.get("size")
    height, width = session.static or said or _exported_size(session) or PROBED_PX
    outputs = session.run(np.zeros((1, 3, height, width), np.float32))
    shapes = [output.shape for output in outputs]
    found = yolo.recognize(shapes, (height, width), session.metadata)
    if found is None:
        raise ModelError(f"outputs {shapes_text(shapes)} fit no known layout: write an adapter (docs/networks.md)")
    return found


def _exported_size(session: NetworkSession) -> tuple[int, int] | None:
    """Height and width in the metadata's `imgsz`, such as [640, 640]."""
    words = session.metadata.get("imgsz", "").strip("[]() ").split(",")
    numbers = [int(word) for word in words if word.strip().isdigit() and len(word) < 6]
    if len(numbers) not in (1, 2) or not all(32 <= n <= 4096 for n in numbers):
        return None
    return numbers[0], numbers[-1]
