"""What a glTF file holds that trimesh reads wrong in silence: named before it is read (glTF 2.0, sections 3.6, 3.7)."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

from meshslam.errors import GeometryError

_ADVICE = "export it without this, or `gltf-transform` takes it out"
_UNREAD = {
    "KHR_mesh_quantization": "quantized vertices",
    "KHR_draco_mesh_compression": "Draco compression",
    "EXT_meshopt_compression": "meshopt compression",
    "KHR_meshopt_compression": "meshopt compression",
    "EXT_mesh_gpu_instancing": "instances",
}
_FLOAT = 5126
_MODES = {5: "triangle strips", 6: "triangle fans"}
_GLB_MAGIC, _JSON_CHUNK = b"glTF", b"JSON"


def is_gltf(path: Path) -> bool:
    """Whether the file's name ends as those of glTF do."""
    return path.suffix.lower() in {".glb", ".gltf"}


def check_gltf(path: Path) -> None:
    """GeometryError naming the extension or feature that would not be read right; nothing for other files."""
    if not is_gltf(path):
        return
    document = _document(path)
    used = [name for name in _list(document, "extensionsUsed") + _list(document, "extensionsRequired")]
    for name in used:
        if name in _UNREAD:
            raise GeometryError(f"{path}: {name} ({_UNREAD[name]}) is not read: {_ADVICE}")
    accessors = _list(document, "accessors")
    for mesh in _list(document, "meshes"):
        for primitive in _list(mesh, "primitives"):
            _check_primitive(path, primitive, accessors)


def _check_primitive(path: Path, primitive: Any, accessors: list[Any]) -> None:  # noqa: ANN401 # as JSON has it
    if not isinstance(primitive, dict):
        raise GeometryError(f"{path}: a mesh's primitive is no JSON object")
    mode = primitive.get("mode", 4)
    if mode in _MODES:
        raise GeometryError(f"{path}: {_MODES[mode]} (primitive mode {mode}) are not read: export triangles")
    attributes = primitive.get("attributes")
    position = attributes.get("POSITION") if isinstance(attributes, dict) else None
    for index in (position, primitive.get("indices")):
        known = isinstance(index, int) and not isinstance(index, bool) and 0 <= index < len(accessors)
        accessor = accessors[index] if known and isinstance(index, int) else None
        if not isinstance(accessor, dict):
            continue
        if "sparse" in accessor:
            raise GeometryError(f"{path}: sparse accessors (accessors[{index}].sparse) are not read: {_ADVICE}")
        if index == position and accessor.get("componentType") != _FLOAT:
            raise GeometryError(f"{path}: vertices of integers (KHR_mesh_quantization) are not read: {_ADVICE}")


def _document(path: Path) -> dict[str, Any]:
    try:
        content = path.read_bytes()
        text = _json_chunk(path, content) if content[:4] == _GLB_MAGIC else content
        document = json.loads(text)
    except OSError as error:
        raise GeometryError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise GeometryError(f"{path}: no glTF: its JSON cannot be read ({str(error)[:100]})") from None
    if not isinstance(document, dict):
        raise GeometryError(f"{path}: no glTF: its JSON is no object")
    return document


def _json_chunk(path: Path, content: bytes) -> bytes:
    """The first chunk of a binary file (glTF 2.0, section 4.4.3)."""
    if len(content) < 20 or content[16:20] != _JSON_CHUNK:
        raise GeometryError(f"{path}: no glTF of version 2: its first chunk is not JSON")
    (length,) = struct.unpack("<I", content[12:16])
    return content[20 : 20 + length]


def _list(owner: Any, key: str) -> list[Any]:  # noqa: ANN401 # as JSON has it
    found = owner.get(key) if isinstance(owner, dict) else None
    return found if isinstance(found, list) else []
