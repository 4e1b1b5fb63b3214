"""The folder that a run writes into: found again, it is resumed."""

from __future__ import annotations

import contextlib
import shutil
from dataclasses import dataclass
from pathlib import Path

from meshslam.errors import MapError
from meshslam.maps.atomic import LEFTOVER_SUFFIX, remove_leftovers, write_atomically

CONFIG = "config.yaml"
MARK = "# meshslam run, version "
OUTPUTS = (
    "map.json",
    "trajectory.tum",
    "detections.json",
    "camera.yaml",
    "metrics.json",
    "map.glb",
    "report.html",
    "recording.rrd",
)
FOLDERS = ("objects",)


@dataclass(frozen=True)
class RunDirectory:
    """A stage is the name of its output file, like `map.json`: it is done when that file is there."""

    folder: Path

    @staticmethod
    def start(folder: Path, config_yaml: str, version: str, *, overwrite: bool = False) -> RunDirectory:
        """Make the folder, or resume a run of the same configuration and version in it.

        `overwrite` drops the outputs of another run that is there. MapError if the folder holds anything but a run, or
        a run of another configuration or version that has put out something and `overwrite` is not set.
        """
        run, content = RunDirectory(Path(folder)), f"{MARK}{version}\n{config_yaml}"
        run._claim()
        found = run._config()
        if found is not None and found != content and run._has_output() and not overwrite:
            raise MapError(
                f"{run.path(CONFIG)}: a run of another configuration is here ({_difference(found, content)}): "
                "choose another --out, or --overwrite it"
            )
        if found is not None and overwrite:
            run._clear()
        if found != content:
            write_atomically(run.path(CONFIG), content.encode())
        return run

    def path(self, stage: str) -> Path:
        """Where a stage's output is, or will be."""
        return self.folder / stage

    def has(self, stage: str) -> bool:
        """Whether a stage is done."""
        return self.path(stage).is_file()

    def save(self, stage: str, content: bytes | str) -> Path:
        """Write a stage's output, whole or not at all; MapError if the disk does not take it."""
        path = self.path(stage)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise MapError(f"{path.parent}: cannot be made: {error.strerror}") from None
        write_atomically(path, content.encode() if isinstance(content, str) else content)
        return path

    def _claim(self) -> None:
        """Make the folder; refuse one that is somebody else's."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            others = [p for p in self.folder.iterdir() if not p.name.endswith(LEFTOVER_SUFFIX)]
        except OSError as error:
            raise MapError(f"{self.folder}: cannot be used as a run directory: {error.strerror}") from None
        if others and self._config() is None:
            names = ", ".join(sorted(p.name for p in others)[:3])
            raise MapError(f"{self.folder}: is no run directory but holds {names}: choose another --out")
        remove_leftovers(self.folder)

    def _config(self) -> str | None:
        """Return config.yaml if it is that of a run."""
        with contextlib.suppress(OSError, UnicodeDecodeError):
            text = self.path(CONFIG).read_text(encoding="utf-8")
            return text if text.startswith(MARK) else None
        return None

    def _has_output(self) -> bool:
        """Whether any stage is done: a run that failed at its start has nothing to lose."""
        return any(self.path(name).exists() for name in (*OUTPUTS, *FOLDERS))

    def _clear(self) -> None:
        """Remove a run's outputs and nothing else."""
        for name in OUTPUTS:
            self.path(name).unlink(missing_ok=True)
        for name in FOLDERS:
            shutil.rmtree(self.path(name), ignore_errors=True)


def _difference(found: str, wanted: str) -> str:
    """Name the first line that differs."""
    ours, theirs = wanted.splitlines(), found.splitlines()
    for a, b in zip(theirs, ours, strict=False):
        if a != b:
            return f"there {a.strip().removeprefix('# ')!r}, now {b.strip().removeprefix('# ')!r}"
    return f"there {len(theirs)} lines, now {len(ours)}"
