"""Arrays in one file (.npz): the same arrays give the same bytes, and a file cannot unpack to more than it may."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

EARLIEST_ZIP_TIME = (1980, 1, 1, 0, 0, 0)


def arrays_to_bytes(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """The .npz file of some arrays, none of them of Python objects: compressed, with fixed time stamps."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for key, array in arrays.items():
            part = io.BytesIO()
            np.lib.format.write_array(part, np.asarray(array), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{key}.npy", EARLIEST_ZIP_TIME), part.getvalue(), zipfile.ZIP_DEFLATED)
    return buffer.getvalue()


def arrays_from_bytes(data: bytes, most_bytes: int) -> dict[str, NDArray[Any]]:
    """The arrays again; ValueError, in words, for no such file, or one that unpacks to more than `most_bytes`."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > most_bytes:
            raise ValueError(f"it says it unpacks to {size} bytes, more than {most_bytes} are not read")
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            return {key: archive[key] for key in archive.files}
    except Exception as error:  # NumPy, zip, zlib and tokenize raise their own kinds
        said = " ".join(str(error).split())[:150]
        raise ValueError(f"not a readable .npz file ({said})") from error
