"""Where a fleet's results are: a folder that all machines share, or one that files are carried to by the driver."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from meshslam.errors import MapError
from meshslam.files import write_atomically
from meshslam.fleet.carried import Changes, files_of, is_passing
from meshslam.fleet.urls import file_system

RUNS = "runs"  # the folder of the run directories
MANIFEST = "manifest.json"


class Place(Protocol):
    """Where runs and the summary are written."""

    @property
    def is_shared(self) -> bool:
        """Whether workers write runs themselves."""
        ...

    def run(self, name: str) -> str:
        """Where the run of a drive is."""
        ...

    def read(self, name: str) -> dict[str, bytes]:
        """The files of a drive's run so far."""
        ...

    def write(self, name: str, changes: Changes) -> None:
        """Put changed files into a drive's run; killed on the way, the run is not complete."""
        ...

    def save(self, file: str, content: bytes) -> None:
        """Write a file of the summary."""
        ...


@dataclass(frozen=True)
class Folder:
    """A local folder; `is_shared` where every machine has it at the same path."""

    folder: Path
    is_shared: bool = True

    def run(self, name: str) -> str:
        """Where the run of a drive is."""
        return str(self.folder / RUNS / name)

    def read(self, name: str) -> dict[str, bytes]:
        """The files of a drive's run so far."""
        return files_of(Path(self.run(name)))

    def write(self, name: str, changes: Changes) -> None:
        """Put changed files into a drive's run; killed on the way, the run is not complete."""
        run = Path(self.run(name))
        for file, content in in_order(changes):
            (run / file).parent.mkdir(parents=True, exist_ok=True)
            if content is None:
                (run / file).unlink(missing_ok=True)
            else:
                write_atomically(run / file, content)

    def save(self, file: str, content: bytes) -> None:
        """Write a file of the summary."""
        self.folder.mkdir(parents=True, exist_ok=True)
        write_atomically(self.folder / file, content)


@dataclass(frozen=True)
class Url:
    """A place that fsspec writes, such as s3://maps/fleet; one driver at a time."""

    url: str
    is_shared: bool = False

    def run(self, name: str) -> str:
        """Where the run of a drive is."""
        return f"{self.url.rstrip('/')}/{RUNS}/{name}"

    def read(self, name: str) -> dict[str, bytes]:
        """The files of a drive's run so far."""
        system, path = file_system(self.run(name))
        found = [file for file in system.find(path) if not is_passing(file)] if system.isdir(path) else []
        return {str(file)[len(path.rstrip("/")) + 1 :]: system.cat_file(file) for file in sorted(found)}

    def write(self, name: str, changes: Changes) -> None:
        """Put changed files into a drive's run; killed on the way, the run is not complete."""
        system, path = file_system(self.run(name))
        for file, content in in_order(changes):
            if content is not None:
                self._put(system, f"{path}/{file}", content)
            elif system.exists(f"{path}/{file}"):
                system.rm_file(f"{path}/{file}")

    def save(self, file: str, content: bytes) -> None:
        """Write a file of the summary."""
        system, path = file_system(f"{self.url.rstrip('/')}/{file}")
        self._put(system, path, content)

    def _put(self, system: Any, path: str, content: bytes) -> None:  # noqa: ANN401 # fsspec's
        """MapError if the place does not take it."""
        try:
            system.makedirs(path.rpartition("/")[0], exist_ok=True)
            system.pipe_file(path, content)
        except Exception as problem:  # each protocol has its own errors
            raise MapError(f"{self.url}: cannot be written: {' '.join(str(problem).split())}") from None


def in_order(changes: Changes) -> list[tuple[str, bytes | None]]:
    """Changes in the order that they are written: the manifest says `complete` last, and not while others change."""
    manifest = changes.get(MANIFEST)
    others = sorted((name, content) for name, content in changes.items() if name != MANIFEST)
    if manifest is None:
        return [*([(MANIFEST, None)] if MANIFEST in changes else []), *others]
    begun = json.dumps({**json.loads(manifest), "complete": False}).encode()
    return [(MANIFEST, begun), *others, (MANIFEST, manifest)]
