"""docs/troubleshooting.md quotes what the program says: every quoted message is in the source."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "python" / "meshslam"
PAGE = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
ROW = re.compile(r"^\| (`[^|]*?) \|", re.MULTILINE)


def text_of(node):
    """A string of the source as it is said, with … for what is put in; None if the node is no string."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else None
    if isinstance(node, ast.JoinedStr):
        return "".join(part.value if isinstance(part, ast.Constant) else "…" for part in node.values)
    return None


def strings(file):
    """Every string of a file that is no docstring."""
    nodes = list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
    docstrings = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    return (text_of(node) for node in nodes if id(node) not in docstrings)


SAID = [text for file in sorted(PACKAGE.rglob("*.py")) for text in strings(file) if text]


def quoted():
    """Each message in the first column of a table."""
    for cell in ROW.findall(PAGE):
        yield from re.findall(r"`([^`]+)`", cell)


@pytest.mark.parametrize("message", sorted(set(quoted())))
def test_a_quoted_message_is_said_by_the_program(message):
    pattern = re.compile(".*".join(re.escape(part.strip()) for part in message.split("…")), re.DOTALL)
    assert any(pattern.search(text) for text in SAID), f"docs/troubleshooting.md: nothing says {message!r}"


def test_every_judgement_of_plausibility_is_explained():
    codes = set()
    for file in (PACKAGE / "plausibility").glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Finding" and node.args:
                codes |= {node.args[0].value} if isinstance(node.args[0], ast.Constant) else set()
    assert len(codes) > 10
    assert [code for code in sorted(codes) if f"`{code}`" not in PAGE] == []


def test_every_reason_for_leaving_a_track_out_is_explained():
    reasons = set()
    for file in (PACKAGE / "mapping").glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "LeftOut":
                reasons.add(node.args[1].value)
    assert len(reasons) > 7
    assert [reason for reason in sorted(reasons) if f"`{reason}`" not in PAGE] == []
