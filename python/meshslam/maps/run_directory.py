"""The folder that a run writes into: found again, it is resumed."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from meshslam.errors import MapError
from meshslam.files import LEFTOVER_SUFFIX, LOCK, remove_leftovers, write_atomically, written_aside
from meshslam.maps.manifest import MESH_FOLDERS, Manifest, written_meshes
from meshslam.maps.map import Map

CONFIG = "config.yaml"
FRAMES = ".meshslam-frames"  # detections of frames, while a run is under way
INDEX = ".meshslam-index.npz"  # of a bag: where its messages lie
MARK = "# meshslam run, version "
TRUTH = "truth"


@dataclass
class RunDirectory:
    """A stage is the name of its output file, like `map.json`.

    A run's result stays until the first file of another is written: then the manifest stops saying `complete`, the
    old files go, and the new ones come; `finish` says `complete` again. Files that no run wrote are left alone.
    """

    folder: Path
    is_complete: bool = False  # nothing is left to do
    _manifest: Manifest = field(default_factory=Manifest)
    _config_yaml: str = ""
    _inputs: Mapping[str, str] = field(default_factory=dict)
    _written: set[str] = field(default_factory=set)
    _replaces: bool = False  # another run's files are there until the first file of this one

    @staticmethod
    def start(
        folder: Path,
        config_yaml: str,
        version: str,
        *,
        inputs: Mapping[str, str] | None = None,
        overwrite: bool = False,
    ) -> RunDirectory:
        """Make the folder, or resume a run of the same configuration, version and input in it.

        `inputs` are digests of what the run reads, by what it is called. `overwrite` replaces the run that is there.
        MapError if the folder holds anything but a run, or a run of another configuration, version or input that has
        put out something and `overwrite` is not set.
        """
        run = RunDirectory(Path(folder), _config_yaml=f"{MARK}{version}\n{config_yaml}", _inputs=inputs or {})
        RunDirectory.claim(run.folder)
        remove_leftovers(run.folder)
        run._manifest, found = Manifest.load(run.folder), run._config()
        whole = found is not None and run._manifest.is_whole(run.folder)
        if not overwrite:
            run._refuse_other_configuration(found)
            run.is_complete = whole
            if whole and inputs is not None:
                run._refuse(run._manifest.without(TRUTH).difference(inputs))
        run._replaces = overwrite and whole
        if not whole and (overwrite or found != run._config_yaml):
            run._renew()
        return run

    def refuse_other_truth(self, digest: str) -> None:
        """MapError if the complete run that is there was compared with another truth than that of this digest."""
        others = [name for name in self._manifest.inputs if name != TRUTH]
        self._refuse(self._manifest.without(*others).difference({TRUTH: digest}))

    @staticmethod
    def claim(folder: Path) -> None:
        """Make the folder of a run; MapError if it is somebody else's, which stays as it is."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
            others = [p.name for p in folder.iterdir() if not p.name.endswith((LEFTOVER_SUFFIX, LOCK, FRAMES, INDEX))]
        except OSError as error:
            raise MapError(f"{folder}: cannot be used as a run directory: {error.strerror}") from None
        if others and RunDirectory(folder)._config() is None:
            names = ", ".join(sorted(others)[:3])
            raise MapError(f"{folder}: is no run directory but holds {names}: choose another --out")

    def path(self, stage: str) -> Path:
        """Where a stage's output is, or will be."""
        return self.folder / stage

    def has(self, stage: str) -> bool:
        """Whether a stage's output is there."""
        return self.path(stage).is_file()

    def save(self, stage: str, content: bytes | str) -> Path:
        """Write a stage's output, whole or not at all; MapError if the disk does not take it."""
        self.announce(stage)
        write_atomically(self.path(stage), content.encode() if isinstance(content, str) else content)
        return self.path(stage)

    def save_map(self, found: Map, progress: Callable[[int, int], None] | None = None) -> None:
        """Write map.json and its meshes; MapError if the disk does not take it; `progress`: as for `Map.save`."""
        self.announce("map.json", *found.mesh_files)
        found.save(self.folder, progress=progress)

    def save_map_again(self, found: Map) -> None:
        """The same for a run that saves its map while it goes on: the map before is whole until this one is."""
        before = written_meshes(self.folder)
        used = {name.partition("/")[0] for name in before}
        meshes = next(name for name in MESH_FOLDERS if name not in used)
        names = found.mesh_files_in(meshes)
        self.announce("map.json", *names)
        left = {p for p in self.path(meshes).glob("*.ply") if p.stem.isdigit()}  # by a process that was killed
        self._remove({str(p.relative_to(self.folder)) for p in left})
        found.save(self.folder, meshes=meshes)
        self._written -= set(before) - set(names)

    @contextlib.contextmanager
    def written(self, stage: str) -> Iterator[Path]:
        """A name beside a stage's output for the block to write; MapError if the disk does not take it."""
        self.announce(stage)
        with written_aside(self.path(stage)) as part:
            yield part

    def announce(self, *stages: str) -> None:
        """Note files before they are written, so that they are known as the run's whatever ends it."""
        if self._replaces:
            self._renew()
        self._written.update(stages)
        files = {*self._manifest.files, *stages}
        if self._manifest.complete or files != set(self._manifest.files):
            self._manifest = Manifest(False, {}, tuple(sorted(files)))
            self._manifest.save(self.folder)
        for stage in stages:
            _make_folder(self.path(stage).parent)

    def finish(self, truth: str | None = None) -> None:
        """Remove what an earlier attempt wrote and this one did not, then say that the run is complete.

        `truth` is the digest of what the estimate was compared with, once it was there.
        """
        files = {CONFIG, *self._written}
        self._remove(set(self._manifest.files) - files)
        self._remove({str(p.relative_to(self.folder)) for p in self.path(FRAMES).glob("*.json")})
        self._manifest = Manifest(
            True, {**self._inputs, **({} if truth is None else {TRUTH: truth})}, tuple(sorted(files))
        )
        self._manifest.save(self.folder)
        self.is_complete = True

    def _config(self) -> str | None:
        """Return config.yaml if it is that of a run."""
        with contextlib.suppress(OSError, UnicodeDecodeError):
            text = self.path(CONFIG).read_text(encoding="utf-8")
            return text if text.startswith(MARK) else None
        return None

    def _refuse(self, difference: str) -> None:
        """MapError if there is a difference of input."""
        if difference:
            raise MapError(
                f"{self.folder}: a run of other input is here ({difference}): choose another --out, or --overwrite it"
            )

    def _refuse_other_configuration(self, found: str | None) -> None:
        """A run that failed at its start has nothing to lose."""
        has_output = any(self.path(name).exists() for name in self._manifest.files if name != CONFIG)
        if found is not None and found != self._config_yaml and has_output:
            raise MapError(
                f"{self.path(CONFIG)}: a run of another configuration is here ({_difference(found, self._config_yaml)})"
                ": choose another --out, or --overwrite it"
            )

    def _renew(self) -> None:
        """Take back `complete`, remove the old run's files, and write the new configuration."""
        self._replaces = False
        if self._manifest.files:
            self._manifest = Manifest(False, {}, self._manifest.files)
            self._manifest.save(self.folder)
        self._remove(set(self._manifest.files) - {CONFIG})
        write_atomically(self.path(CONFIG), self._config_yaml.encode())
        if self._manifest.files:
            self._manifest = Manifest(False, {}, (CONFIG,))
            self._manifest.save(self.folder)

    def _remove(self, files: set[str]) -> None:
        """Remove files of the run, and folders that are empty then; MapError names one that stays."""
        try:
            for name in sorted(files):
                self.path(name).unlink(missing_ok=True)
        except OSError as error:
            raise MapError(f"{error.filename}: cannot be removed: {error.strerror}") from None
        for folder in {self.path(name).parent for name in files} - {self.folder}:
            with contextlib.suppress(OSError):
                folder.rmdir()


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MapError(f"{folder}: cannot be made: {error.strerror}") from None


def _difference(found: str, wanted: str) -> str:
    """Name the first line that differs."""
    ours, theirs = wanted.splitlines(), found.splitlines()
    for a, b in zip(theirs, ours, strict=False):
        if a != b:
            above = _above(ours, b)
            return f"there {above + a.strip().removeprefix('# ')!r}, now {above + b.strip().removeprefix('# ')!r}"
    return f"there {len(theirs)} lines, now {len(ours)}"


def _above(lines: list[str], line: str) -> str:
    """The names that a YAML line stands under, with dots."""
    names: list[str] = []
    depth = len(line) - len(line.lstrip())
    for before in reversed(lines[: lines.index(line)]):
        indent = len(before) - len(before.lstrip())
        if indent < depth:
            names.insert(0, before.strip().removesuffix(":"))
            depth = indent
    return "".join(f"{name}." for name in names)
