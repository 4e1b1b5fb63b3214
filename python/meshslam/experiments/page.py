"""What an experiment leaves: figures as CSV and JSON, pictures, a page that puts the paper's numbers beside ours."""

from __future__ import annotations

import base64
import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2

from meshslam.geometry import Bytes
from meshslam.maps import write_together
from meshslam.viewing import number, table, text

Cell = float | int | str | None
_STYLE = (
    "body{font:15px system-ui,sans-serif;margin:2em auto;max-width:1180px;color:#222;padding:0 1em}"
    "img,svg{max-width:100%;height:auto}td,th{padding:.2em 1em;text-align:right}td:first-child,th:first-child"
    "{text-align:left}table{border-collapse:collapse}tr{border-bottom:1px solid #ddd}.scroll{overflow-x:auto}"
    "figure{margin:1.5em 0}figcaption{color:#555}"
)


@dataclass(frozen=True)
class Claim:
    """A number of the paper's beside ours."""

    what: str
    paper: Cell
    ours: Cell


@dataclass(frozen=True)
class Picture:
    """A file with what it shows."""

    name: str  # with its suffix: .png, .svg or .html
    caption: str
    content: bytes


@dataclass(frozen=True)
class Experiment:
    """All that an experiment has to say."""

    name: str
    title: str
    text: str
    claims: Sequence[Claim]
    rows: Sequence[Mapping[str, Cell]]
    summary: Mapping[str, Cell]
    pictures: Sequence[Picture]


def write_experiment(found: Experiment, folder: Path) -> Path:
    """Write NAME.csv, NAME.json, the pictures and, last, report.html; returns its path. MapError if that fails."""
    folder.mkdir(parents=True, exist_ok=True)
    report = folder / "report.html"
    files = {folder / picture.name: picture.content for picture in found.pictures}
    files[folder / f"{found.name}.csv"] = _csv(found.rows).encode()
    document = {
        "experiment": found.name,
        "claims": [vars(claim) for claim in found.claims],
        **found.summary,
        "rows": [dict(row) for row in found.rows],
    }
    files[folder / f"{found.name}.json"] = (json.dumps(document, indent=1, allow_nan=False) + "\n").encode()
    files[report] = _page(found).encode()
    write_together(files, report)
    return report


def png(image: Bytes) -> bytes:
    """A BGR image as a PNG file."""
    return cv2.imencode(".png", image)[1].tobytes()


def _page(found: Experiment) -> str:
    claims = [[text(claim.what), _cell(claim.paper), _cell(claim.ours)] for claim in found.claims]
    columns = list(found.rows[0]) if found.rows else []
    rows = [[_cell(row[key]) for key in columns] for row in found.rows]
    drawn = {p.name.removesuffix(".svg") for p in found.pictures if p.name.endswith(".svg")}
    shown = [p for p in found.pictures if p.name.removesuffix(".png") not in drawn]
    figures = "".join(f"<figure>{_figure(p)}<figcaption>{text(p.caption)}</figcaption></figure>" for p in shown)
    return (
        f'<!doctype html><html lang=en><meta charset="utf-8"><title>{text(found.title)}</title><style>{_STYLE}</style>'
        f"<h1>{text(found.title)}</h1><p>{text(found.text)}</p>"
        f"{table(['', 'paper', 'here'], claims)}{figures}<h2>All figures</h2>"
        f"{table([text(c) for c in columns], rows)}</html>\n"
    )


def _figure(picture: Picture) -> str:
    if picture.name.endswith(".png"):
        code = base64.b64encode(picture.content).decode()
        return f'<img alt="{text(picture.caption)}" src="data:image/png;base64,{code}">'
    content = picture.content.decode()
    return content[content.index("<svg") :]


def _cell(value: Cell) -> str:
    if value is None or isinstance(value, float):
        return number(value, 3)
    return text(value)


def _csv(rows: Sequence[Mapping[str, Cell]]) -> str:
    content = io.StringIO()
    if rows:
        writer = csv.DictWriter(content, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    return content.getvalue()
