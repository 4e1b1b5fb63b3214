"""Hostile meshes and tensors for some minutes, also in `make fuzz`: `python scripts/fuzz_autodiff.py [SECONDS] [SEED]`.

Goes through the cases of tests/autodiff/hostile.py: the core's batched losses, and each framework that is installed. A
crash ends the process that ran it and names its seed. Ends with 1 if anything failed.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CASES = 20_000  # of a seed


def main(seconds: float, seed: int) -> int:
    """Go through seeds until the time is over; the number of seeds with problems."""
    began, first, failed = time.monotonic(), seed, 0
    while seed == first or time.monotonic() - began < seconds:
        settings = {"MESHSLAM_MUTATIONS": str(CASES), "MESHSLAM_FUZZ_SEED": str(seed)}
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "-x",
            "--no-header",
            "--tb=short",
            "tests/autodiff/test_hostile.py",
        ]
        ended = subprocess.run(
            command, cwd=ROOT, env=os.environ | settings, capture_output=True, text=True, check=False
        )
        if ended.returncode:
            failed += 1
            print(f"seed {seed}:\n{ended.stdout[-3000:]}{ended.stderr[-500:]}", flush=True)
        seed += 1
    print(f"{seed - first} seeds, {CASES} cases each: {failed} with problems")
    return failed


if __name__ == "__main__":
    given = [float(word) for word in sys.argv[1:]] + [600.0, 0.0][len(sys.argv) - 1 :]
    sys.exit(1 if main(given[0], int(given[1])) else 0)
