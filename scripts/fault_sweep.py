"""Every step of every command that writes: killed, interrupted, disk full there; then judged, and run again.

`PYTHONPATH=python:. python scripts/fault_sweep.py [--only NAME] [--every N]` prints the table of docs/reliability.md.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from tests.faults.harness import Zygote, disturb, undisturbed
from tests.faults.inputs import cases_of

FAULTS = ("kill", "full", "interrupt")


def sweep(folder: Path, only: str, every: int, faults: list[str]) -> int:
    """Print a row a command and fault; the number of broken promises."""
    memory = folder / "memory"
    memory.mkdir()
    zygote, broken = Zygote(folder), 0
    print(
        "| command | fault | steps | tried | left behind | broken |\n| --- | --- | --- | --- | --- | --- |", flush=True
    )
    for case in cases_of(folder, zygote, memory):
        if only not in case.name:
            continue
        steps = undisturbed(zygote, case, memory)
        for fault in faults:
            case.found.clear()
            problems = []
            tried = range(1, steps + 2, every)
            for at in tried:
                try:
                    disturb(zygote, case, at, fault, memory)
                except AssertionError as error:
                    problems.append(str(error))
            counts = ", ".join(f"{count} {name.split(': ')[1]}" for name, count in sorted(case.found.items()))
            print(f"| {case.name} | {fault} | {steps} | {len(tried)} | {counts} | {len(problems)} |", flush=True)
            for problem in problems[:5]:
                print(problem, file=sys.stderr, flush=True)
            broken += len(problems)
    zygote.close()
    return broken


def main() -> int:
    """Sweep; exit code 1 if a promise was broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="part of a command's name")
    parser.add_argument("--every", type=int, default=1, help="every N-th step")
    parser.add_argument("--fault", choices=FAULTS, action="append", help="these faults alone")
    chosen, began_s = parser.parse_args(), time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        broken = sweep(Path(folder), chosen.only, chosen.every, chosen.fault or list(FAULTS))
    print(f"{broken} broken promises, {time.monotonic() - began_s:.0f} s", file=sys.stderr)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
