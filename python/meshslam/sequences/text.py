"""Readers of plain text: columns of numbers, times, YAML."""

from __future__ import annotations

import csv
import reprlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from meshslam.errors import GeometryError
from meshslam.geometry import Floats, Pose, nearest_rotation
from meshslam.sequences.report import Report, fail

LARGEST = 1e30  # of any quantity in a file: squares stay finite, and nanoseconds have 1e18
_EXACT, _ROUNDED = 1e-4, 1e-2  # by which a rotation's columns may be off orthonormal: three decimals make 2e-3

_MAX_ALIASES = 24  # nested ones multiply: so many make 3^8 times as much at most
_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxlist, _SHORT.maxdict = 2, 4, 3


@dataclass(frozen=True, eq=False)
class Table:
    """Finite numbers with the line each row stands on."""

    rows: Floats  # (n, columns)
    lines: tuple[int, ...]  # counted from 1


def read_text(path: Path) -> str:
    """Read a UTF-8 file, a byte order mark at its start or not; FoundError if it is missing or unreadable."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise fail(path, "", "no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise fail(path, "", f"cannot be read as text: {error}") from None


def read_table(path: Path, columns: int, report: Report, *, by_line: bool = False) -> Table:
    """Read `columns` numbers a line, blanks between; empty lines and lines that start with # are skipped.

    Where a line belongs to a frame (`by_line`), an empty one between others is a problem.
    """
    texts = [(n, line.split()) for n, line in enumerate(read_text(path).rstrip().splitlines(), 1)]
    for n, words in texts if by_line else []:
        if not words:
            report.add(
                path, f"line {n}", "is blank, but each line belongs to a frame: give its value, or leave none out"
            )
    return parse_table(
        path, [(n, words) for n, words in texts if words and not words[0].startswith("#")], columns, report
    )


def read_csv(path: Path, names: tuple[str, ...], report: Report) -> Table:
    """Read a comma-separated file whose header holds exactly `names`."""
    try:
        lines = list(enumerate(csv.reader(read_text(path).splitlines()), 1))
    except csv.Error as error:
        raise fail(path, "", f"cannot be read as CSV: {error}") from None
    header = tuple(word.strip().lstrip("#").strip() for word in lines[0][1]) if lines else ()
    if header != names:
        raise fail(path, "line 1", f"expected the header {','.join(names)}, found {','.join(header) or 'nothing'}")
    return parse_table(path, [(n, words) for n, words in lines[1:] if words], len(names), report)


def parse_table(path: Path, lines: list[tuple[int, list[str]]], columns: int, report: Report) -> Table:
    """Turn words into finite numbers; each line that is none is reported and left out."""
    rows, numbers = [], []
    for number, words in lines:
        problem, values = _parse_row(words, columns)
        if problem:
            report.add(path, f"line {number}", problem)
        else:
            rows.append(values)
            numbers.append(number)
    return Table(np.array(rows, float).reshape(-1, columns), tuple(numbers))


def _parse_row(words: list[str], columns: int) -> tuple[str, list[float]]:
    if len(words) != columns:
        return f"expected {columns} numbers, found {len(words)}", []
    try:
        values = [float(word) for word in words]
    except ValueError:
        return f"expected {columns} numbers, found {' '.join(words)[:80]!r}", []
    if not (np.abs(values) < LARGEST).all():
        return f"expected finite numbers below {LARGEST:g}, found {' '.join(words)[:80]!r}", []
    return "", values


def check_increasing(path: Path, times_s: Floats, lines: tuple[int, ...], report: Report) -> None:
    """Report every time that is not after the one before it."""
    for i in np.flatnonzero(np.diff(times_s) <= 0):
        report.add(
            path,
            f"line {lines[i + 1]}",
            f"time {times_s[i + 1]:.9g} s is not after {times_s[i]:.9g} s of line {lines[i]}; times must increase",
        )


def read_times(path: Path, report: Report) -> Floats:
    """Read one time a line in seconds, increasing; at least one."""
    table = read_table(path, 1, report, by_line=True)
    times_s = table.rows[:, 0]
    check_increasing(path, times_s, table.lines, report)
    if not len(times_s):
        raise fail(path, "", "holds no times: the sequence is empty")
    return times_s


def read_yaml(path: Path) -> dict[str, Any]:
    """Read a mapping, also with OpenCV's `%YAML:1.0` header and `!!opencv-matrix` tags."""
    return yaml_mapping(path, read_text(path))


def yaml_mapping(path: Path, text: str) -> dict[str, Any]:
    """The mapping of a YAML or JSON text, with OpenCV's header and tags or without; an end mark may follow it."""
    text = text.rstrip().removesuffix("\n---")
    if text.startswith("%YAML:"):
        text = "\n" + text.partition("\n")[2]
    content = parsed_yaml(path, text.replace("!!opencv-matrix", "").replace("!!opencv-nd-matrix", ""))
    if not isinstance(content, dict):
        raise fail(path, "", "expected `key: value` lines")
    return {str(key): value for key, value in content.items()}


def parsed_yaml(path: Path, text: str, loader: type[yaml.SafeLoader] = yaml.SafeLoader) -> Any:  # noqa: ANN401 # what YAML holds
    """The document; SequenceError in one line for what is no YAML, or would grow without bounds when it is unpacked."""
    try:
        _check_aliases(path, text)
        return yaml.load(text, Loader=loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}" if mark else ""
        raise fail(path, where, f"not valid YAML: {_short(getattr(error, 'problem', None) or error)}") from None
    except RecursionError:
        raise fail(path, "", "not valid YAML: nested too deeply") from None
    except (ValueError, OverflowError) as error:  # dates that are none, numbers of thousands of digits
        raise fail(path, "", f"not valid YAML: {_short(error)}") from None


def _check_aliases(path: Path, text: str) -> None:
    """Refuse more aliases (*name) than files have: each may stand for many others, and 1 kB unpacks to gigabytes."""
    if "*" not in text:
        return
    lines = [t.start_mark.line for t in yaml.scan(text) if isinstance(t, yaml.AliasToken)]
    if len(lines) > _MAX_ALIASES:
        raise fail(path, f"line {lines[_MAX_ALIASES] + 1}", f"more than {_MAX_ALIASES} aliases (*name): write them out")


def _short(said: object) -> str:
    return " ".join(str(said).split())[:150]


def numbers_of(path: Path, key: str, value: object) -> Floats:
    """Turn a YAML value (number, nested lists or an OpenCV matrix) into finite numbers."""
    array: Floats
    try:
        if isinstance(value, dict) and {"rows", "cols", "data"} <= value.keys():
            array = np.asarray(value["data"], float).reshape(int(value["rows"]), int(value["cols"]))
        elif isinstance(value, dict) and {"sizes", "data"} <= value.keys():  # OpenCV 5 of an array (n,)
            array = np.asarray(value["data"], float).reshape(np.atleast_1d(value["sizes"]).astype(int))
        else:
            array = np.asarray(value, float)
    except (TypeError, ValueError, OverflowError, RecursionError):
        raise fail(path, key, f"expected numbers, found {_SHORT.repr(value)}") from None
    if not (np.abs(array) < LARGEST).all():
        raise fail(path, key, f"expected finite numbers below {LARGEST:g}, found {_SHORT.repr(value)}")
    return array


def pose_of(path: Path, key: str, value: object, report: Report) -> Pose:
    """Turn a YAML value into a rigid transform."""
    array = numbers_of(path, key, value)
    if array.size != 16:
        raise fail(path, key, f"expected a 4x4 matrix, found {array.size} numbers")
    return rigid(path, key, array.reshape(4, 4), report)


def rigid(path: Path, where: str, matrix: Floats, report: Report) -> Pose:
    """Check that a (4, 4) or (3, 4) matrix is a rigid transform; one of few decimals is made one, and noted."""
    square = np.eye(4)
    square[: len(matrix)] = matrix
    rotation = square[:3, :3]
    off = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    if _EXACT < off < _ROUNDED and np.linalg.det(rotation) > 0:
        report.note(
            path, where, f"the rotation is {off:.1g} off orthonormal: rounded numbers, the nearest one is taken"
        )
        square[:3, :3] = nearest_rotation(rotation)
    try:
        return Pose.from_matrix(square)
    except GeometryError as error:
        raise fail(path, where, str(error)) from None
