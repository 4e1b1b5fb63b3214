"""The measured figures that README and docs/results.md quote: docs/results.json, one entry a case.

Benchmarks write it. An entry has the command that measured it, the day, the package's version, and its figures.
README and docs/results.md get their table from it by `scripts/results_table.py`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

FILE = Path(__file__).resolve().parent.parent / "docs" / "results.json"
DECIMALS = 4


def record(case: str, command: str, figures: Mapping[str, float | list[float]], file: Path = FILE) -> None:
    """Write a case's figures in place of those it had; other cases stay."""
    found = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    found[case] = {
        "command": command,
        "day": f"{datetime.now(UTC):%Y-%m-%d}",
        "version": version("meshslam"),
        "figures": {name: rounded(value) for name, value in figures.items()},
    }
    file.write_text(json.dumps(dict(sorted(found.items())), indent=1) + "\n", encoding="utf-8")


def rounded(value: float | list[float]) -> float | list[float]:
    """To the decimals that mean something."""
    return [round(float(one), DECIMALS) for one in value] if isinstance(value, list) else round(float(value), DECIMALS)
