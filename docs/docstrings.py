"""How this code base's docstrings become pages: comments of fields are their text, examples are code."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from typing import Any

import griffe

EXAMPLE = re.compile(r"^Example:\n((?:[ ]{4}.*\n?|\n)+)", re.MULTILINE)
SESSION = re.compile(r"^>>> .*\n(?:^(?!$).*\n?)*", re.MULTILINE)


class Docstrings(griffe.Extension):
    """Fits docstrings and fields for mkdocstrings."""

    def on_instance(self, *, obj: griffe.Object, **_kwargs: Any) -> None:  # noqa: ANN401 # griffe's hook
        """Put examples and interpreter sessions into fences."""
        if obj.docstring is not None and not obj.is_alias:
            obj.docstring.value = with_fences(obj.docstring.value)

    def on_attribute_instance(self, *, attr: griffe.Attribute, **_kwargs: Any) -> None:  # noqa: ANN401 # griffe's hook
        """Read the comment of a field, or its setting's `doc`; show the default alone.

        `noqa` and type comments are for tools.
        """
        told = _arguments(attr.value)
        text = ast.literal_eval(told["doc"]) if "doc" in told else _last_comment(attr.source or "")
        if attr.docstring is None and attr.lineno is not None and text and not text.startswith(("noqa", "type:")):
            attr.docstring = griffe.Docstring(text[0].upper() + text[1:].rstrip(".") + ".", parent=attr)
        if told:
            attr.value = told.get("value", f"{told['default_factory']}()" if "default_factory" in told else None)


def with_fences(text: str) -> str:
    """A docstring with its examples as fenced code."""
    text = EXAMPLE.sub(lambda m: f"```python\n{_dedented(m[1])}\n```\n", text)
    return SESSION.sub(lambda m: f"```pycon\n{m[0].rstrip()}\n```\n", text)


def _dedented(lines: str) -> str:
    return "\n".join(line[4:] for line in lines.rstrip().splitlines())


def _arguments(value: Any) -> dict[str, str]:  # noqa: ANN401 # griffe's expressions
    """What a field's call says: `field(…)` of dataclasses, or a setting with its default, bounds and `doc`."""
    if not isinstance(value, griffe.ExprCall) or str(value.function) not in ("field", "setting", "public", "expert"):
        return {}
    named = {a.name: str(a.value) for a in value.arguments if isinstance(a, griffe.ExprKeyword)}
    first = [str(a) for a in value.arguments if not isinstance(a, griffe.ExprKeyword)][:1]
    return named | ({"value": first[0]} if first else {})


def _last_comment(source: str) -> str:
    try:
        tokens = list(tokenize.generate_tokens(io.StringIO(source).readline))
    except (tokenize.TokenError, IndentationError):
        return ""
    comments = [token.string.lstrip("# ") for token in tokens if token.type == tokenize.COMMENT]
    return comments[-1].strip().rstrip(".") if comments else ""
