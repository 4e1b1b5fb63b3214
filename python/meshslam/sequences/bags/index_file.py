"""The index of a bag as a file, so that a bag is read through once only."""

from __future__ import annotations

import io
import json
from array import array
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.files import write_atomically
from meshslam.sequences.bags.decoding import decoded
from meshslam.sequences.bags.index import BagIndex, Edge, Topic, build_index
from meshslam.sequences.bags.kinds import KINDS
from meshslam.sequences.bags.store import Channel, Position, Store
from meshslam.sequences.report import Report

_FORMAT = 1
_ARRAYS = {"header_ns": "q", "log_ns": "q", "values": "d"}


@dataclass(frozen=True, eq=False)
class KeptIndex:
    """What was read of a bag, and what was said meanwhile; see RecordingIndex."""

    index: BagIndex
    notes: tuple[tuple[str, str, str], ...]  # file, place in it, what
    state: list[Any]  # of the bag's files, when they were read
    lies_in: Path | None = None  # where it was read from

    def save(self, path: Path) -> None:
        """Write an .npz file: names and numbers as JSON, times and values as arrays; whole or not at all."""
        if path == self.lies_in:
            return
        arrays: dict[str, Any] = {}
        topics = [_topic_out(topic, f"topic{i}", arrays) for i, topic in enumerate(self.index.topics.values())]
        edges = [(*pair, edge.is_static) for pair, edge in self.index.edges.items()]
        for i, edge in enumerate(self.index.edges.values()):
            arrays[f"edge{i}_ns"], arrays[f"edge{i}_values"] = np.array(edge.times_ns), np.array(edge.values)
        head = {
            "format": _FORMAT,
            "state": self.state,
            "notes": self.notes,
            "topics": dict(zip(self.index.topics, topics, strict=True)),
            "edges": edges,
            "transform_topics": sorted(self.index.transform_topics),
        }
        content = io.BytesIO()
        np.savez(content, head=np.frombuffer(json.dumps(head).encode(), np.uint8), **arrays)
        write_atomically(path, content.getvalue())


def indexed(store: Store, kept: Path | None, report: Report) -> KeptIndex:
    """The index in the file `kept` if it is of these files as they are now; else a new one."""
    state = _state(store)
    found = None if kept is None or not kept.is_file() else _load(kept, store, state)
    if found is None:
        told = len(report.problems)
        index = build_index(store, report)
        notes = tuple((str(n.file), n.where, n.what) for n in report.problems[told:] if n.severity == "note")
        return KeptIndex(index, notes, state)
    for file, where, what in found.notes:
        report.note(Path(file), where, what)
    return found


def _state(store: Store) -> list[Any]:
    """Name, size and time of change of each file."""
    stats = [(file, file.stat()) for file in store.files if file.is_file()]
    return [[str(file), stat.st_size, stat.st_mtime_ns] for file, stat in stats]


def _load(kept: Path, store: Store, state: list[Any]) -> KeptIndex | None:
    """None for what cannot be used: the bag is read again then."""
    try:
        with np.load(io.BytesIO(kept.read_bytes()), allow_pickle=False) as file:
            head = json.loads(file["head"].tobytes())
            if head["format"] != _FORMAT or head["state"] != state:
                return None
            index = BagIndex(store.path, transform_topics=set(head["transform_topics"]))
            for i, (name, told) in enumerate(head["topics"].items()):
                index.topics[name] = _topic_in(store.path, told, f"topic{i}", file)
            for i, (parent, child, is_static) in enumerate(head["edges"]):
                times_ns, values = file[f"edge{i}_ns"].tobytes(), file[f"edge{i}_values"].tobytes()
                index.edges[parent, child] = Edge(is_static, array("q", times_ns), array("d", values))
            return KeptIndex(index, tuple((str(f), str(w), str(t)) for f, w, t in head["notes"]), state, kept)
    except Exception:  # a damaged archive raises whatever zipfile, numpy or json come upon
        return None


def _topic_out(topic: Topic, key: str, arrays: dict[str, Any]) -> dict[str, Any]:
    for name in _ARRAYS:
        arrays[f"{key}_{name}"] = np.array(getattr(topic, name))
    arrays[f"{key}_positions"] = np.array(topic.positions, np.int64).reshape(-1, 3)
    arrays[f"{key}_keys"] = np.array(topic.keys, bool)
    arrays[f"{key}_schema"] = np.frombuffer(topic.channel.schema, np.uint8)
    arrays[f"{key}_camera"] = np.frombuffer(topic.camera_data, np.uint8)
    told = {
        name: getattr(topic, name) for name in ("count", "unreadable", "why", "frame", "child_frame", "form", "changes")
    }
    return told | {"channel": {name: v for name, v in asdict(topic.channel).items() if name != "schema"}}


def _topic_in(path: Path, told: dict[str, Any], key: str, file: Any) -> Topic:  # noqa: ANN401 # numpy's archive
    channel = Channel(**told.pop("channel"), schema=file[f"{key}_schema"].tobytes())
    topic = Topic(channel, KINDS.get(channel.type_name), **told)
    for name, code in _ARRAYS.items():
        setattr(topic, name, array(code, file[f"{key}_{name}"].tobytes()))
    topic.positions = [Position(*row) for row in file[f"{key}_positions"].tolist()]
    topic.keys = file[f"{key}_keys"].tolist()
    topic.camera_data = file[f"{key}_camera"].tobytes()
    if topic.camera_data:
        topic.camera = decoded(path, channel, topic.camera_data)
    return topic
