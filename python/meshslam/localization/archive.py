"""The file of a saved system (.npz): its format, the newest IMU samples, arrays by name."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.errors import MapError, MeshslamError
from meshslam.maps import write_atomically
from meshslam.sequences import ImuSamples


def write_archive(path: Path, kind: str, imu: ImuSamples, arrays: Mapping[str, Any]) -> None:
    """Write the file, whole or not at all."""
    samples = np.column_stack([imu.times_s, imu.angular_rate_rad_s, imu.specific_force_m_s2])
    buffer = io.BytesIO()
    np.savez(buffer, **{"format": np.array(kind), "imu": samples, **arrays})
    write_atomically(Path(path), buffer.getvalue())


def read_archive(path: Path, kind: str) -> tuple[ImuSamples, dict[str, Any]]:
    """The samples and arrays of a file of this kind; MapError if it is none, or damaged."""
    try:
        _check_sizes(Path(path))
        with np.load(Path(path), allow_pickle=False) as archive:
            arrays = {key: archive[key] for key in archive.files}
        right, imu = str(arrays.pop("format")) == kind, arrays.pop("imu")
    except Exception as error:  # NumPy, zip, zlib and tokenize raise their own kinds
        raise MapError(f"{path}: cannot be read as a saved system: {_said(error)}") from None
    if not right:
        raise MapError(f"{path}: was saved by another version, expected {kind}")
    if imu.dtype.kind != "f" or imu.shape[1:] != (7,):
        raise MapError(f"{path}: is damaged: imu has shape {imu.shape}, expected (n, 7)")
    return ImuSamples(imu[:, 0], imu[:, 1:4], imu[:, 4:]), arrays


@contextmanager
def archive_errors(path: Path | str) -> Iterator[None]:
    """MapError for whatever is wrong with the arrays of a saved system that the block reads."""
    try:
        yield
    except MeshslamError as error:
        raise MapError(f"{path}: is damaged: {_said(error)}") from None
    except Exception as error:
        raise MapError(f"{path}: is damaged, or of other arguments: {type(error).__name__}: {_said(error)}") from error


_MAX_PACKED_BYTES = 64 << 20  # of a packed array; those that are saved are not packed


def _check_sizes(path: Path) -> None:
    """ValueError for a member that unpacks to far more than the file can honestly hold: it is not unpacked."""
    with zipfile.ZipFile(path) as archive:
        for member in archive.infolist():
            stored = member.compress_type == zipfile.ZIP_STORED
            if member.file_size > (member.compress_size if stored else _MAX_PACKED_BYTES):
                raise ValueError(f"{member.filename[:40]} says it unpacks to {member.file_size} bytes")


def _said(error: Exception) -> str:
    return " ".join(str(error).split())[:150]


def under(prefix: str, arrays: Mapping[str, Any]) -> dict[str, Any]:
    """The arrays whose names begin so, without the beginning."""
    return {key.removeprefix(prefix): value for key, value in arrays.items() if key.startswith(prefix)}
