"""Fixtures shared by every room's tests."""

import os
from pathlib import Path

import numpy as np
import pytest

os.environ.setdefault("MESHSLAM_RECORDING", "0")  # a second of each run, which tests of it ask for
REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The real data for tests: `$MESHSLAM_DATA`, or ../shared/data beside the checkout."""
    folder = Path(os.environ.get("MESHSLAM_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        reason = f"no test data at {folder}: set MESHSLAM_DATA to the folder that holds kitti_raw, cars, models"
        if os.environ.get("MESHSLAM_REQUIRE_DATA") == "1":
            pytest.fail(reason)
        pytest.skip(reason)
    return folder


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator with a fixed seed."""
    return np.random.default_rng(7)
