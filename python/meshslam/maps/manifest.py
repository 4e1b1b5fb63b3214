"""What a run directory holds: which files a run wrote, from which input, and whether it came to its end."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from meshslam.files import write_atomically

MANIFEST = "manifest.json"
FORMAT, VERSION = "meshslam-run", 1
MESHES = "objects"  # the folder of a map's meshes
MESH_FOLDERS = (MESHES, f"{MESHES}-2")  # and the other one of maps that are saved again and again
_MOVING = {"mesh": "moving/{}.ply", "path": "moving/{}.csv", "trajectory": "moving/{}.tum"}  # of an entry of map.json
_EARLIER = (  # what runs without a manifest wrote
    "map.json",
    "trajectory.tum",
    "detections.json",
    "camera.yaml",
    "metrics.json",
    "map.glb",
    "report.html",
    "recording.rrd",
    "path.png",
    "iterations.png",
)


@dataclass(frozen=True)
class Manifest:
    """The run's files, and the digests of what it read by what that is called; `complete` is written last."""

    complete: bool = False
    inputs: Mapping[str, str] = field(default_factory=dict)
    files: tuple[str, ...] = ()

    def save(self, folder: Path) -> None:
        """Write it into a run directory; MapError if the disk does not take it."""
        document = {
            "format": FORMAT,
            "version": VERSION,
            "complete": self.complete,
            "inputs": dict(sorted(self.inputs.items())),
            "files": sorted(self.files),
        }
        write_atomically(folder / MANIFEST, (json.dumps(document, indent=1) + "\n").encode())

    @staticmethod
    def load(folder: Path) -> Manifest:
        """The manifest of a run directory; that of an earlier version's run lists what such runs wrote."""
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
            found = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
            inputs = {str(name): str(digest) for name, digest in found["inputs"].items()}
            return Manifest(found["complete"] is True, inputs, _inside(found["files"]))
        files = tuple(name for name in (*_EARLIER, *written_meshes(folder)) if (folder / name).is_file())
        return Manifest({"metrics.json", "report.html"} <= set(files), {}, files)

    def is_whole(self, folder: Path) -> bool:
        """Whether the run came to its end and every file of it is still there."""
        return self.complete and all((folder / name).is_file() for name in self.files)

    def without(self, *names: str) -> Manifest:
        """The same, but of some inputs nothing is known."""
        return replace(self, inputs={name: digest for name, digest in self.inputs.items() if name not in names})

    def difference(self, inputs: Mapping[str, str]) -> str:
        """Name what was read and is another now; empty if nothing."""
        if not self.inputs and inputs:
            return f"{', '.join(inputs)}: not recorded then"
        changed = [name for name, digest in inputs.items() if self.inputs.get(name, digest) != digest]
        new = [f"{name} (not there then)" for name in inputs if name not in self.inputs]
        gone = [f"{name} (not there now)" for name in self.inputs if name not in inputs]
        return ", ".join(changed + new + gone)


def _inside(names: list[str]) -> tuple[str, ...]:
    """The names that stay in the folder: what a damaged manifest says must not be removed elsewhere."""
    return tuple(name for name in names if not Path(name).is_absolute() and ".." not in Path(name).parts)


def written_meshes(folder: Path) -> tuple[str, ...]:
    """The meshes and paths that a folder's map.json names and that a map wrote."""
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        document = json.loads((folder / "map.json").read_text(encoding="utf-8"))
        meshes = [e["mesh"] for e in document["objects"] if e["mesh"] in {f"{f}/{e['id']}.ply" for f in MESH_FOLDERS}]
        moving = [
            e[key] for e in document.get("moving", []) for key in _MOVING if e[key] == _MOVING[key].format(e["id"])
        ]
        return (*meshes, *moving)
    return ()
