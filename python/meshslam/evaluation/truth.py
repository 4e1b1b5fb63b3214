"""Truth as it lies beside a sequence: the only reader of these files."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from meshslam.errors import SequenceError
from meshslam.files import digest_of, digest_of_file
from meshslam.maps import Map, Trajectory


@dataclass(frozen=True, eq=False)
class Truth:
    """What is known of a sequence; None where there is no file."""

    objects: Map | None
    object_of_annotation: dict[int, int] | None
    path: Trajectory | None

    def detections_of(self, object_id: int) -> int:
        """How many detections show an object; 0 where association is not known."""
        return Counter((self.object_of_annotation or {}).values())[object_id]


def read_truth(sequence_folder: Path, *, allow_outside: bool = False) -> Truth:
    """Read objects.json, association.json and groundtruth.tum, those that are there.

    Meshes of the objects outside the folder are read with `allow_outside` only.

    MapError or SequenceError, naming the file and the key or line, if one of them is damaged.
    """
    objects, association, path = (
        sequence_folder / name for name in ("objects.json", "association.json", "groundtruth.tum")
    )
    return Truth(
        Map.load(objects, allow_outside=allow_outside) if objects.is_file() else None,
        _read_association(association) if association.is_file() else None,
        Trajectory.load(path) if path.is_file() else None,
    )


def truth_digest(sequence_folder: Path) -> str:
    """Digest of the truth beside a sequence, meshes included; to be asked for once the estimate is on disk."""
    named = [*_named(sequence_folder / "objects.json", "objects"), *_named(sequence_folder / "moving.json", "moving")]
    names = ["objects.json", "association.json", "groundtruth.tum", "moving.json", *named]
    files = [sequence_folder / name for name in names]
    return digest_of({name: digest_of_file(file) for name, file in zip(names, files, strict=True) if file.is_file()})


def _named(path: Path, key: str) -> list[str]:
    """What the true objects name as their meshes and paths."""
    try:
        entries = json.loads(path.read_text(encoding="utf-8"))[key]
        return [str(entry[name]) for entry in entries for name in ("mesh", "path") if name in entry]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return []


def _read_association(path: Path) -> dict[int, int]:
    """Annotation id to object id."""
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise SequenceError(f"{path}: cannot be read as JSON: {error}") from None
    if not isinstance(rows, dict):
        raise SequenceError(f"{path}: expected an object of annotation id: object id, found {type(rows).__name__}")
    for key, value in rows.items():
        if not key.isdecimal() or not isinstance(value, int) or isinstance(value, bool):
            raise SequenceError(f"{path}: {key!r}: expected annotation id: object id, found {value!r}")
    return {int(key): value for key, value in rows.items()}
