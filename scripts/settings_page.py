"""Write docs/settings.md from the declarations of the settings; `--check` only says whether it is as they are.

.venv/bin/python scripts/settings_page.py [--check]
"""

import ast
import inspect
import io
import sys
import textwrap
import tokenize
from pathlib import Path

from meshslam.runs import Config, users
from meshslam.settings import parts_of, settings_of
from meshslam.simulation import SimulationConfig

PAGE = Path(__file__).resolve().parent.parent / "docs" / "settings.md"
INTRO = """\
# Settings

This page is made by `scripts/settings_page.py` from the declarations in the code.

A configuration file (`--config`) holds public settings at their place and expert ones in the same tree under `expert`.
Public settings are those that a camera, a car or a drive gives reason to change. Expert ones tune the method.

```yaml
mapping:
  max_distance_m: 30
slam:
  lag_s: 5
expert:
  slam:
    points:
      corners: 200
```

A run's `config.yaml` holds all settings that its command uses. `--config config.yaml` repeats the run.
In Python the tree is flat: `Config().slam.points.corners`.

A setting is refused if it is unknown, out of range, at the wrong place, or not used by the command.
The message names the setting and says what to write. For a name of version 0.1 it says the new one.
"""
SECTIONS = {
    "Public settings": ("public", Config, "", True),
    "Expert settings": (
        "expert",
        Config,
        "A meaning that begins with “and” or “likewise” goes on from the row above.\n",
        True,
    ),
    "Settings of `meshslam simulate`": (
        "plain",
        SimulationConfig,
        "`meshslam simulate --config` takes these; a sequence's `simulation.yaml` holds them all.\n",
        False,
    ),
}


def comments(kind):
    """The comment behind each field of a class."""
    source = textwrap.dedent(inspect.getsource(kind))
    ends = {
        node.end_lineno: node.target.id for node in ast.parse(source).body[0].body if isinstance(node, ast.AnnAssign)
    }
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    found = ((token.start[0], token.string) for token in tokens if token.type == tokenize.COMMENT)
    return {ends[line]: text.lstrip("# ") for line, text in found if line in ends}


def rows(kind, before=""):
    """Path, setting and meaning of every setting of a class and its parts."""
    meant = comments(kind)
    for name, known in settings_of(kind).items():
        yield f"{before}{name}", known, known.about.doc or meant.get(name, "")
    for name, part in parts_of(kind).items():
        yield from rows(part, f"{before}{name}.")


def range_of(known):
    """What may be written."""
    if known.literals or bool in known.types:
        return ", ".join(known.literals or ("true", "false"))
    words = {int: "whole number", float: "number", str: "text"}
    kind = f"{'list of ' if known.is_list else ''}{words[known.types[0]]}"
    text = " ".join(part for part in (kind, known.about.bounds.text, known.unit) if part)
    return f"{text}, or null" if known.takes_none else text


def default_of(known):
    """As YAML has it."""
    value = known.default
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, tuple):
        return f"[{', '.join(map(str, value))}]"
    return str(value) if value != "" else ""


def page():
    """The whole text."""
    parts = [INTRO]
    for title, (kind, config, text, by_command) in SECTIONS.items():
        chosen = [row for row in rows(config) if row[1].about.kind == kind]
        by = " used by |" if by_command else ""
        lines = [f"\n## {title}\n", *([text] if text else []), f"| setting | default | range |{by} meaning |"]
        lines.append("| --- | --- | --- |" + (" --- |" if by_command else "") + " --- |")
        for path, known, meaning in chosen:
            used = f" {', '.join(users(path))} |" if by_command else ""
            cells = (f"`{path}`", default_of(known), range_of(known))
            lines.append(f"| {' | '.join(cells)} |{used} {meaning} |")
        parts.append("\n".join(lines) + "\n")
    return "".join(parts)


def main():
    """Write the page, or compare it with the one that is there."""
    if "--check" not in sys.argv[1:]:
        PAGE.write_text(page(), encoding="utf-8")
        return 0
    if PAGE.read_text(encoding="utf-8") != page():
        print(f"{PAGE}: not as the code declares the settings: run scripts/settings_page.py")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
