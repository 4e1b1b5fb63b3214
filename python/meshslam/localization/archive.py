"""The file of a saved system (.npz): its format, the newest IMU samples, arrays by name."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.errors import MapError
from meshslam.maps import write_atomically
from meshslam.sequences import ImuSamples


def write_archive(path: Path, kind: str, imu: ImuSamples, arrays: Mapping[str, Any]) -> None:
    """Write the file, whole or not at all."""
    samples = np.column_stack([imu.times_s, imu.angular_rate_rad_s, imu.specific_force_m_s2])
    buffer = io.BytesIO()
    np.savez(buffer, **{"format": np.array(kind), "imu": samples, **arrays})
    write_atomically(Path(path), buffer.getvalue())


def read_archive(path: Path, kind: str) -> tuple[ImuSamples, dict[str, Any]]:
    """The samples and arrays of a file of this kind; MapError if it is none."""
    try:
        with np.load(Path(path), allow_pickle=False) as archive:
            arrays = {key: archive[key] for key in archive.files}
        right, imu = str(arrays.pop("format")) == kind, arrays.pop("imu")
    except (OSError, ValueError, KeyError) as error:
        raise MapError(f"{path}: cannot be read as a saved system: {error}") from None
    if not right:
        raise MapError(f"{path}: was saved by another version, expected {kind}")
    return ImuSamples(imu[:, 0], imu[:, 1:4], imu[:, 4:]), arrays


def under(prefix: str, arrays: Mapping[str, Any]) -> dict[str, Any]:
    """The arrays whose names begin so, without the beginning."""
    return {key.removeprefix(prefix): value for key, value in arrays.items() if key.startswith(prefix)}
