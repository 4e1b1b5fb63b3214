"""Each room imports another through its face only: `from meshslam.ROOM import NAME`, NAME being in `__all__`.

Also: a face's names are sorted and all there, no name hides a module of its room, and a public name has one home. What
a face says to type checkers, in its imports, is what it hands out when it runs, by `deferred`.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent.parent / "python" / "meshslam"


def faces(package: Path) -> dict[str, list[str]]:
    """The names in `__all__` of every room."""
    return {
        face.parent.name: _all(ast.parse(face.read_text(encoding="utf-8")))
        for face in sorted(package.glob("*/__init__.py"))
    }


def _all(tree: ast.Module) -> list[str]:
    for node in tree.body:
        if isinstance(node, ast.Assign) and [t.id for t in node.targets if isinstance(t, ast.Name)] == ["__all__"]:
            return list(ast.literal_eval(node.value))
    return []


def imports(path: Path) -> Iterator[tuple[int, str, list[str]]]:
    """Line, module and names of every import of the package in a file."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield node.lineno, node.module, [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            yield node.lineno, "." * node.level + (node.module or ""), [alias.name for alias in node.names]
        elif isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name, []) for alias in node.names)


def promised(tree: ast.Module) -> dict[str, str]:
    """The module of each name that a face imports for type checkers."""
    blocks = [n.body for n in tree.body if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING"]
    found = [node for block in blocks for node in block if isinstance(node, ast.ImportFrom)]
    return {alias.name: node.module or "" for node in found for alias in node.names}


def handed_out(tree: ast.Module, room: str) -> dict[str, str]:
    """The module of each name that a face's `deferred` finds."""
    calls = [n for n in ast.walk(tree) if isinstance(n, ast.Call) and ast.unparse(n.func) == "deferred"]
    tables = [ast.literal_eval(call.args[1]) for call in calls]
    return {name: f"{room}.{module}" for table in tables for module, names in table.items() for name in names.split()}


def uneven(package: Path) -> Iterator[str]:
    """Names that a face promises to type checkers and does not hand out alike, or not as one of its names."""
    for face in sorted(package.glob("*/__init__.py")):
        tree = ast.parse(face.read_text(encoding="utf-8"))
        said, given = promised(tree), handed_out(tree, f"{package.name}.{face.parent.name}")
        for name in sorted(said.keys() | given.keys()):
            if said.get(name) != given.get(name):
                yield (
                    f"{face.parent.name}/__init__.py: {name} comes from {said.get(name, 'nowhere')} for type checkers, "
                    f"from {given.get(name, 'nowhere')} at run time"
                )
        missing = sorted(said.keys() - set(_all(tree)))
        yield from (f"{face.parent.name}/__init__.py: {name} is not in __all__" for name in missing)


def problems(package: Path) -> Iterator[str]:
    """What is wrong, one line each."""
    rooms = faces(package)
    yield from uneven(package)
    for room, names in rooms.items():
        hidden = {p.stem for p in (package / room).iterdir()} & set(names)
        yield from (f"{room}/__init__.py: {name} hides the module of that name" for name in sorted(hidden))
    for path in sorted(package.rglob("*.py")):
        where, own = path.relative_to(package), path.relative_to(package).parts[0]
        for line, module, names in imports(path):
            if module.startswith("."):
                yield f"{where}:{line}: relative import of {module}: name the room"
            first, _, rest = module.partition(".")
            room = rest.partition(".")[0]
            if first != package.name or room not in rooms or room == own:
                continue
            if rest != room:
                yield f"{where}:{line}: imports {module}, which is behind the face of {room}"
            yield from (
                f"{where}:{line}: {name} is not in __all__ of {room}" for name in names if name not in rooms[room]
            )


def main() -> int:
    """Print the problems; exit code 1 if there are any."""
    found = list(problems(PACKAGE))
    print("\n".join(found), end="\n" if found else "")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
