"""Fail if modules of the core import each other in a circle: its top-level modules, or the files of one folder."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

SOURCES = Path(__file__).resolve().parent.parent / "crates" / "core" / "src"
Module = tuple[str, ...]
NOT_CODE = re.compile(r'//[^\n]*|"(?:\\.|[^"\\])*"|#\[cfg\(test\)\].*', re.DOTALL)
PATH = re.compile(r"\b(?:crate|self|super)::(?:\w+::)*(?:\{|\w+)")
USE = re.compile(r"\buse\s+(\w+)\b(?=::)")


def module_of(file: Path, sources: Path) -> Module:
    """A file's path in the crate; a folder's `mod.rs`, and `lib.rs`, stand for what they open."""
    parts = file.relative_to(sources).with_suffix("").parts
    return parts[:-1] if parts[-1] in ("mod", "lib") else parts


def paths(code: str) -> Iterator[str]:
    """Every path that starts at the crate, at the parent or at the module itself; trees in braces written out."""
    for found in PATH.finditer(code):
        if found.group().endswith("{"):
            yield from (found.group()[:-1] + leaf for leaf in leaves(code, found.end()))
        else:
            yield found.group()


def leaves(code: str, start: int) -> Iterator[str]:
    """The paths of a tree `a, b::{c, d}` whose brace opened just before `start`."""
    prefixes, word = [""], ""
    for character in code[start:]:
        if character == "{":
            prefixes.append(prefixes[-1] + word)
            word = ""
        elif character in ",}":
            if word:
                yield prefixes[-1] + word
            word = ""
            if character == "}":
                prefixes.pop()
                if not prefixes:
                    return
        elif not character.isspace():
            word += character


def resolved(path: str, module: Module, modules: set[Module]) -> Module:
    """The module that a path leads into: the longest beginning of it that is one."""
    parts = path.split("::")
    base = () if parts[0] == "crate" else module
    for part in parts:
        base = base[:-1] if part == "super" else base
    whole = base + tuple(p for p in parts if p not in ("crate", "super", "self"))
    return next(whole[:n] for n in range(len(whole), -1, -1) if whole[:n] in modules)


def imports(sources: Path) -> dict[Module, set[Module]]:
    """Which modules each module names."""
    files = {module_of(file, sources): file for file in sorted(sources.rglob("*.rs"))}
    out: dict[Module, set[Module]] = {}
    for module, file in files.items():
        code = NOT_CODE.sub(" ", file.read_text())
        children = (name for name in USE.findall(code) if (*module, name) in files)
        named = [*paths(code), *(f"self::{name}" for name in children)]
        out[module] = {resolved(path, module, set(files)) for path in named} - {module}
    return out


def circles(sources: Path) -> list[list[str]]:
    """A circle of each folder's modules that has one; what lies deeper counts as the folder's module that holds it."""
    found = imports(sources)
    out = []
    for folder in {module[:-1] for module in found if module}:
        inside = {m: names for m, names in found.items() if m[: len(folder)] == folder}
        graph: dict[Module, set[Module]] = {}
        for module, names in inside.items():
            here = module[: len(folder) + 1]
            there = {n[: len(folder) + 1] for n in names if n in inside}
            graph.setdefault(here, set()).update(there - {here})
        try:
            TopologicalSorter(graph).prepare()
        except CycleError as error:
            # the sorter names each module before those that import it
            out.append(["::".join(("crate", *module)) for module in reversed(error.args[1])])
    return out


def main() -> int:
    """Print each circle; exit code 1 if there is one."""
    found = circles(SOURCES)
    for circle in found:
        print("modules of the core import each other in a circle: " + " -> ".join(circle))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
