"""The comment behind a dataclass field, or the `doc` of a public setting, as its text in the reference."""

from __future__ import annotations

import ast
import io
import textwrap
import tokenize
from typing import Any

import griffe


class FieldComments(griffe.Extension):
    """Gives each attribute without a docstring the comment at its line's end."""

    def on_attribute_instance(self, *, attr: griffe.Attribute, **_kwargs: Any) -> None:  # noqa: ANN401 # griffe's hook
        """Read the comment; `noqa` and type comments are for tools."""
        if attr.docstring is not None or attr.lineno is None or not attr.source:
            return
        text = _doc(attr.source) or _last_comment(attr.source)
        if text and not text.startswith(("noqa", "type:")):
            attr.docstring = griffe.Docstring(text[0].upper() + text[1:] + ".", parent=attr)


def _doc(source: str) -> str:
    """What `public(..., doc="...")` says."""
    try:
        (statement,) = ast.parse(textwrap.dedent(source)).body
    except (SyntaxError, ValueError):
        return ""
    value = statement.value if isinstance(statement, ast.AnnAssign) else None
    found = [word.value for word in value.keywords if word.arg == "doc"] if isinstance(value, ast.Call) else []
    return str(found[0].value) if found and isinstance(found[0], ast.Constant) else ""


def _last_comment(source: str) -> str:
    try:
        tokens = list(tokenize.generate_tokens(io.StringIO(source).readline))
    except (tokenize.TokenError, IndentationError):
        return ""
    comments = [token.string.lstrip("# ") for token in tokens if token.type == tokenize.COMMENT]
    return comments[-1].strip().rstrip(".") if comments else ""
