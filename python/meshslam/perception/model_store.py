"""Networks that a user has put where runs find them by name: each with its checksum and its licence."""

from __future__ import annotations

import hashlib
import json
import os
import re
from dataclasses import asdict, dataclass
from pathlib import Path

from meshslam.errors import ModelError
from meshslam.files import remove_leftovers_of, write_atomically
from meshslam.perception.adapter import adapter_beside, read_adapter
from meshslam.perception.network_session import NOT_ONNX, not_onnx
from meshslam.perception.onnx_runtime import inference_session

FOLDER_VARIABLE = "MESHSLAM_MODELS"
ADVICE = (
    "get an instance segmentation network as ONNX (RF-DETR-seg, Apache-2.0; YOLO11n-seg: `yolo export "
    "model=yolo11n-seg.pt format=onnx`, AGPL-3.0: docs/networks.md) and run `meshslam models add FILE`, or give "
    "--segmenter FILE (segmenter='FILE' in Python)"
)


@dataclass(frozen=True)
class StoredModel:
    """A network in the store."""

    name: str
    path: Path
    size: int  # bytes
    sha256: str
    licence: str


def store_folder() -> Path:
    """Where networks are kept: $MESHSLAM_MODELS, or meshslam/models in the user's data folder."""
    given = os.environ.get(FOLDER_VARIABLE)
    data = os.environ.get("XDG_DATA_HOME") or str(Path.home() / ".local" / "share")
    return Path(given) if given else Path(data) / "meshslam" / "models"


def add_model(
    path: Path, name: str | None = None, licence: str | None = None, adapter: Path | None = None
) -> StoredModel:
    """Copy an ONNX file into the store; the name is the file's unless given, the licence the file's metadata's.

    Its adapter goes with it: the one given, or the one that lies beside it.
    ModelError if it is no ONNX model, another model has the name, or the disk does not take it.
    """
    path = Path(path)
    if path.suffix.lower() in NOT_ONNX:
        raise ModelError(not_onnx(path))
    if not path.is_file():
        raise ModelError(f"{path}: no such file, expected an ONNX model")
    name = name or path.stem
    if not re.fullmatch(r"[\w][\w.+-]*", name):
        raise ModelError(f"{name!r}: expected a name of letters, digits, dots, dashes")
    content = path.read_bytes()
    found = licence or _metadata(path).get("license") or "not stated in the file: ask who made it"
    target = store_folder() / f"{name}.onnx"
    model = StoredModel(name, target, len(content), hashlib.sha256(content).hexdigest(), found)
    if target.exists() and hashlib.sha256(target.read_bytes()).hexdigest() != model.sha256:
        raise ModelError(f"{target}: another model has the name {name!r}: give --name")
    notes = {key: value for key, value in asdict(model).items() if key not in ("path", "name")}
    _make_store(target)
    # A network without its notes would stop every run that looks into the store: they come first
    write_atomically(_notes(target), (json.dumps(notes, indent=1) + "\n").encode(), ModelError)
    said = adapter or adapter_beside(path)
    if adapter is not None or said.is_file():
        read_adapter(said)
        write_atomically(adapter_beside(target), said.read_bytes(), ModelError)
    if not target.exists():
        write_atomically(target, content, ModelError)
    return model


def stored_models() -> tuple[StoredModel, ...]:
    """The networks in the store by name; ModelError if a file's notes are missing or damaged."""
    folder = store_folder()
    files = sorted(folder.glob("*.onnx")) if folder.is_dir() else []
    return tuple(_stored(path) for path in files)


def find_model(chosen: str | None) -> Path:
    """The network that a run uses: a file's path, a name in the store, or the only one there if nothing is chosen.

    ModelError, with what to do, if there is none, or if a stored file is not what was added.
    """
    if chosen is not None and (Path(chosen).is_file() or os.sep in chosen or chosen.endswith(".onnx")):
        return Path(chosen)
    if chosen is not None and Path(chosen).suffix.lower() in NOT_ONNX:
        raise ModelError(not_onnx(Path(chosen)))
    models = stored_models()
    listed = ", ".join(m.name for m in models) or "none"
    if chosen is None and not models:
        raise ModelError(f"there is no segmentation network in {store_folder()}: {ADVICE}")
    if chosen is None and len(models) > 1:
        raise ModelError(f"several networks are in the store: choose one with --segmenter NAME: {listed}")
    found = [m for m in models if chosen is None or m.name == chosen]
    if not found:
        raise ModelError(f"no network {chosen!r} in {store_folder()} (there: {listed}): {ADVICE}")
    if hashlib.sha256(found[0].path.read_bytes()).hexdigest() != found[0].sha256:
        raise ModelError(f"{found[0].path}: its checksum is not that of the file that was added: add it again")
    return found[0].path


def _make_store(target: Path) -> None:
    """Make the store's folder; what adding this network has left there when it was killed goes."""
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ModelError(f"{target.parent}: cannot be made: {error.strerror}") from None
    for path in (target, _notes(target)):
        remove_leftovers_of(path)


def _notes(path: Path) -> Path:
    return path.with_suffix(".json")


def _stored(path: Path) -> StoredModel:
    try:
        notes = json.loads(_notes(path).read_text(encoding="utf-8"))
        return StoredModel(path.stem, path, int(notes["size"]), str(notes["sha256"]), str(notes["licence"]))
    except (OSError, ValueError, KeyError, TypeError):
        raise ModelError(f"{_notes(path)}: missing or damaged: run `meshslam models add` again") from None


def _metadata(path: Path) -> dict[str, str]:
    try:
        session = inference_session(path)
    except Exception as error:  # the runtime's own exceptions have no common base but this
        line = (str(error).strip().splitlines() or [type(error).__name__])[0][:200]
        raise ModelError(f"{path}: cannot be loaded as an ONNX model: {line}") from None
    metadata: dict[str, str] = session.get_modelmeta().custom_metadata_map
    return metadata
