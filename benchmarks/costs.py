"""What drives, cars and tiles cost on this machine: every figure of docs/scale.md that is measured, in one command.

    .venv/bin/python benchmarks/costs.py [--work FOLDER] [--only steps driver tiles merging]

Writes docs/scale.json. Processor time is told where it can be, as other programs may run. Needs the extra `ray`, and
the data and tools that `$MESHSLAM_DATA` names (default ../shared/data, its tools beside it). Takes about 20 minutes.
"""

from __future__ import annotations

import argparse
import json
import os
import re
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from cost_parts.cases import ROOT, Case, cases
from cost_parts.driver import measured_driver
from cost_parts.merging import measured_merging
from cost_parts.steps import measured_steps
from cost_parts.tiles import measured_tiles

from meshslam.fleet.drives import Drive, Needs
from meshslam.fleet.jobs import Job
from meshslam.runs import Config, overlaid

FILE = ROOT / "docs" / "scale.json"
DIGITS = 5


def tiny_job(case: Case, out: Path) -> Job:
    """Two frames through the network, in a folder of their own."""
    settings = overlaid(Config(), {"input": {**case.given, "frames": "0:2"}}, "tiny")
    return Job(Drive("tiny", case.given["sequence"], "map", settings), "detect", Needs(), version("meshslam"), str(out))


def measure(part: str, work: Path) -> Any:  # of each part its own
    """One part of the costs."""
    if part == "steps":
        return measured_steps(work / "steps")
    if part == "tiles":
        return measured_tiles(work / "tiles", work / "steps" / "runs" / "masks_70_6_map")
    if part == "merging":
        return measured_merging(work / "merging")
    street = cases(work / "steps")[0]
    return measured_driver(work, lambda out: tiny_job(street, out))


def rounded(value: Any) -> Any:  # JSON
    """Numbers to the digits that mean something."""
    if isinstance(value, dict):
        return {key: rounded(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(one) for one in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def write(found: dict[str, Any]) -> None:
    """Replace docs/scale.json: an innermost list or row is a line."""
    text = json.dumps(found, indent=1)
    for brackets in (r"\[[^][{}]*\]", r"\{[^][{}]*\}"):
        text = re.sub(brackets, lambda match: " ".join(match.group().split()), text)
    FILE.write_text(text + "\n", encoding="utf-8")


def main() -> None:
    """Measure, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parts = ("steps", "driver", "tiles", "merging")
    parser.add_argument("--work", type=Path, default=ROOT / "benchmarks" / "out" / "costs")
    parser.add_argument("--only", nargs="+", choices=parts, default=parts)
    a = parser.parse_args()
    os.environ["MESHSLAM_RECORDING"] = "0"
    (a.work / "steps").mkdir(parents=True, exist_ok=True)
    for part in a.only:
        print(f"{part}:", flush=True)
        found = json.loads(FILE.read_text()) if FILE.is_file() else {}
        about = {"day": f"{datetime.now(UTC):%Y-%m-%d}", "version": version("meshslam"), "cpus": os.cpu_count()}
        found[part] = {**about, "figures": rounded(measure(part, a.work))}
        write(found)


if __name__ == "__main__":
    main()
