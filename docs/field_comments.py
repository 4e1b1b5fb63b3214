"""The comment behind a dataclass field as its text in the reference: shapes and units stand there in this code base."""

from __future__ import annotations

import io
import tokenize
from typing import Any

import griffe


class FieldComments(griffe.Extension):
    """Gives each attribute without a docstring the comment at its line's end."""

    def on_attribute_instance(self, *, attr: griffe.Attribute, **_kwargs: Any) -> None:  # noqa: ANN401 # griffe's hook
        """Read the comment; `noqa` and type comments are for tools."""
        if attr.docstring is not None or attr.lineno is None or not attr.source:
            return
        text = _last_comment(attr.source)
        if text and not text.startswith(("noqa", "type:")):
            attr.docstring = griffe.Docstring(text[0].upper() + text[1:] + ".", parent=attr)


def _last_comment(source: str) -> str:
    try:
        tokens = list(tokenize.generate_tokens(io.StringIO(source).readline))
    except (tokenize.TokenError, IndentationError):
        return ""
    comments = [token.string.lstrip("# ") for token in tokens if token.type == tokenize.COMMENT]
    return comments[-1].strip().rstrip(".") if comments else ""
