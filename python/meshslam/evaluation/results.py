"""Figures of protocols as CSV, JSON, Markdown and LaTeX."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from meshslam.evaluation.protocols import Measured
from meshslam.viewing import better_of

ARROWS = {"lower": "↓", "higher": "↑", None: ""}  # what is better
_LATEX_ARROWS = {"lower": r"$\downarrow$", "higher": r"$\uparrow$", None: ""}
_LATEX_SPECIAL = {"_": r"\_", "%": r"\%", "&": r"\&", "#": r"\#"}


def short(value: float) -> str:
    """A figure to four digits, near 1 to five, such as scales; counts as they are."""
    if isinstance(value, int):
        return str(value)
    return f"{value:.5g}" if 0.9 < abs(value) < 1.1 else f"{value:.4g}"


def to_csv(rows: Sequence[Measured], about: Mapping[str, Any]) -> str:
    """One line a figure, with all its digits; protocols without figures have their reason in the last column."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["protocol", "group", "figure", "value", "better", "not_computed"])
    for row in rows:
        for key, value in row.figures.items():
            writer.writerow([row.protocol, row.group, key, repr(value), better_of(key) or "", ""])
        if row.reason is not None:
            writer.writerow([row.protocol, row.group, "", "", "", row.reason])
    return out.getvalue()


def to_json(rows: Sequence[Measured], about: Mapping[str, Any]) -> str:
    """All there is: what was measured, `figures` by their keys, and `protocols` with sources and reasons."""
    figures = {key: value for row in rows for key, value in row.figures.items()}
    protocols = [
        {"name": r.protocol, "group": r.group, "source": r.source, "figures": r.figures}
        | ({} if r.reason is None else {"not_computed": r.reason})
        for r in rows
    ]
    return json.dumps({**about, "figures": figures, "protocols": protocols}, indent=1, allow_nan=False) + "\n"


def to_markdown(rows: Sequence[Measured], about: Mapping[str, Any]) -> str:
    """A table, and a list of what was not computed."""
    lines = ["| protocol | figure | value | better |", "| --- | --- | ---: | --- |"]
    for row in rows:
        for key, value in row.figures.items():
            lines.append(f"| {row.protocol} | `{key}` | {short(value)} | {ARROWS[better_of(key)]} |")
    left = [f"- {row.protocol}: {row.reason}" for row in rows if row.reason is not None]
    return "\n".join([*lines, *(["", "Not computed:", "", *left] if left else [])]) + "\n"


def to_latex(rows: Sequence[Measured], about: Mapping[str, Any]) -> str:
    """A tabular of the package booktabs; what was not computed is a comment."""
    lines = [r"\begin{tabular}{llr}", r"\toprule", r"protocol & figure & value \\", r"\midrule"]
    for row in rows:
        for key, value in row.figures.items():
            arrow = _LATEX_ARROWS[better_of(key)]
            lines.append(rf"{row.protocol} & {_latex(key)} {arrow} & {short(value)} \\")
    left = [f"% not computed: {row.protocol}: {row.reason}" for row in rows if row.reason is not None]
    return "\n".join([*left, *lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


FORMATS: dict[str, Callable[[Sequence[Measured], Mapping[str, Any]], str]] = {
    ".csv": to_csv,
    ".json": to_json,
    ".md": to_markdown,
    ".tex": to_latex,
}


def formatted(suffix: str, rows: Sequence[Measured], about: Mapping[str, Any]) -> str:
    """The text of a file of that ending, one of FORMATS; `about` says what was measured, and how."""
    return FORMATS[suffix](rows, about)


def _latex(text: str) -> str:
    return "".join(_LATEX_SPECIAL.get(character, character) for character in text)
