"""What is free goes back to the system, though something above it is still in use."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from meshslam.runs.memory import give_back_memory


def resident_mb():
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the C library does as it likes")
def test_free_pages_are_handed_back():
    give_back_memory()
    before, size = resident_mb(), 100_000  # below the size from which each array has pages of its own
    arrays = [np.ones(size, np.uint8) for _ in range(1000)]
    last = arrays[-1]
    del arrays
    assert resident_mb() > before + 50
    give_back_memory()
    assert resident_mb() < before + 20
    assert last.all()
