"""Damaged files for some minutes, also a part of `make fuzz`: `python scripts/fuzz_readers.py [SECONDS] [SEED]`.

Each seed gives every reader of files other damage, as tests/sequences/test_damaged_files.py and
tests/perception/test_mutations.py say. Prints what fails with its seed, and ends with 1 if anything did.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TESTS = (
    "tests/sequences/test_damaged_files.py",
    "tests/sequences/test_camera_files.py::test_damaged_files",
    "tests/perception/test_mutations.py",
)
MUTATIONS = 500  # of each reader and seed


def main(seconds: float, seed: int) -> int:
    """Go through seeds until the time is over; the number of seeds with problems."""
    began, first, failed = time.monotonic(), seed, 0
    while seed == first or time.monotonic() - began < seconds:
        settings = {"MESHSLAM_MUTATIONS": str(MUTATIONS), "MESHSLAM_FUZZ_SEED": str(seed)}
        command = [sys.executable, "-m", "pytest", "-q", "-x", "--no-header", "--tb=short", *TESTS]
        ended = subprocess.run(
            command, cwd=ROOT, env=os.environ | settings, capture_output=True, text=True, check=False
        )
        if ended.returncode:
            failed += 1
            print(f"seed {seed}:\n{ended.stdout[-3000:]}{ended.stderr[-500:]}", flush=True)
        seed += 1
    print(f"{seed - first} seeds, {MUTATIONS} damaged files a reader and seed: {failed} with problems")
    return failed


if __name__ == "__main__":
    given = [float(word) for word in sys.argv[1:]] + [600.0, 0.0][len(sys.argv) - 1 :]
    sys.exit(1 if main(given[0], int(given[1])) else 0)
