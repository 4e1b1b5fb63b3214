#!/usr/bin/env bash
# trimesh 5.2.0 reads three kinds of valid glTF 2.0 meshes as other shapes, without a word.
#
# The file is one tetrahedron with edges of 1 m, written four times:
#   float       positions as floats: read right
#   normalized  KHR_mesh_quantization, normalized 16-bit integers (value / 32767 by the specification, section 3.11):
#               the integers come as metres, so the shape is 32767 times too large
#   sparse      positions of an accessor without a buffer, given as sparse values (section 3.6.2.3): the values are
#               left out, every vertex is 0
#   fan         one quadrilateral as a triangle fan (mode 6, section 3.7.2.1): no triangle is read
# Each is read by trimesh.load_mesh(..., process=False), which raises nothing and warns of nothing.
# The script fails if any of this changes.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check "trimesh==5.2.0" "numpy==2.4.6"
cat > "$work/see.py" <<'PY'
import json
import struct
import sys
import warnings
from pathlib import Path

import numpy as np
import trimesh

warnings.simplefilter("error")
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.uint16)
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
BOX = {"min": [0, 0, 0], "max": [1, 1, 1]}
INDICES = {"bufferView": 0, "componentType": 5123, "count": 12, "type": "SCALAR"}


def write(path, parts, accessors, primitive, strides=(), extensions=()):
    blob, views = b"", []
    for number, part in enumerate(parts):
        view = {"buffer": 0, "byteOffset": len(blob), "byteLength": len(part)}
        views.append(view | ({"byteStride": dict(strides)[number]} if number in dict(strides) else {}))
        blob += part + bytes(-len(part) % 4)
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}], "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": len(blob)}],
    }
    if extensions:
        document |= {"extensionsUsed": list(extensions), "extensionsRequired": list(extensions)}
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<III", 0x46546C67, 2, 28 + len(text) + len(blob))
    path.write_bytes(head + struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(blob), 0x004E4942) + blob)


folder, triangles = Path(sys.argv[1]), {"attributes": {"POSITION": 1}, "indices": 0}
floats = {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC3", **BOX}
write(folder / "float.glb", [FACES.tobytes(), CORNERS.tobytes()], [INDICES, floats], triangles)
padded = np.zeros((4, 4), np.int16)
padded[:, :3] = np.round(CORNERS * 32767)
whole = {"bufferView": 1, "componentType": 5122, "normalized": True, "count": 4, "type": "VEC3"}
whole |= {"min": [0, 0, 0], "max": [32767] * 3}
write(folder / "normalized.glb", [FACES.tobytes(), padded.tobytes()], [INDICES, whole], triangles, [(1, 8)],
      ["KHR_mesh_quantization"])
sparse = {"componentType": 5126, "count": 4, "type": "VEC3", **BOX, "sparse": {
    "count": 3, "indices": {"bufferView": 1, "componentType": 5123}, "values": {"bufferView": 2}}}
write(folder / "sparse.glb", [FACES.tobytes(), np.array([1, 2, 3], np.uint16).tobytes(), CORNERS[1:].tobytes()],
      [INDICES, sparse], triangles)
flat = {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}
write(folder / "fan.glb", [SQUARE.tobytes()], [flat], {"attributes": {"POSITION": 0}, "mode": 6})

for name in ("float", "normalized", "sparse", "fan"):
    mesh = trimesh.load_mesh(folder / f"{name}.glb", process=False)
    mesh = mesh.to_mesh() if isinstance(mesh, trimesh.Scene) else mesh
    longest = float(np.ptp(mesh.vertices, axis=0).max()) if len(mesh.vertices) else 0.0
    print(f"{name}: {len(mesh.faces)} faces, longest side {longest:g}")
PY
"$work/venv/bin/python" "$work/see.py" "$work" | tee "$work/seen"
diff - "$work/seen" <<'EOF'
float: 4 faces, longest side 1
normalized: 4 faces, longest side 32767
sparse: 4 faces, longest side 0
fan: 0 faces, longest side 0
EOF
echo "as stated: trimesh 5.2.0"
