"""One page for each public name of each room, made while the site is built: mkdocstrings fills it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import griffe
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

PACKAGE = Path("python/meshslam")
KINDS = (("class", "Classes"), ("function", "Functions"), ("attribute", "Constants and types"))


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the rooms' pages."""
    package = griffe.load("meshslam", search_paths=[str(PACKAGE.parent)], resolve_aliases=True)
    for face in sorted(PACKAGE.glob("*/__init__.py")):
        for name, text in pages(package[face.parent.name]):
            files.append(File.generated(config, f"reference/{face.parent.name}/{name}.md", content=text))
    return files


def pages(room: griffe.Module) -> Iterator[tuple[str, str]]:
    """File names and texts: one page a public name, and one that lists them."""
    names = [str(name).strip("'\"") for name in room.exports or ()]
    if room.name == "cli":
        return
    for name in names:
        path = f"meshslam.{room.name}.{name}"
        yield file_name(name, names), f"# {room.name}.{name}\n\n[All names of {room.name}](index.md)\n\n::: {path}\n"
    said = room.docstring.value if room.docstring else ""
    rows = [f"# {room.name}\n", said, f"\n`from meshslam.{room.name} import …`\n"]
    for kind, heading in KINDS:
        listed = [name for name in names if room[name].kind.value == kind]
        if listed:
            rows += [f"\n## {heading}\n", "| name | what it is |", "| --- | --- |"]
            rows += [f"| [`{name}`]({file_name(name, names)}.md) | {first_line(room[name])} |" for name in listed]
    yield "index", "\n".join(rows) + "\n"


def file_name(name: str, names: list[str]) -> str:
    """The name itself; a class beside a function that differs in case alone is told apart on any file system."""
    same = [other for other in names if other.lower() == name.lower()]
    return f"{name}_class" if len(same) > 1 and name[0].isupper() else name


def first_line(thing: griffe.Object | griffe.Alias) -> str:
    """What the docstring says first."""
    text = thing.docstring.value.splitlines()[0] if thing.docstring else ""
    return text.replace("|", "\\|")
