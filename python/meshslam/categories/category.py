"""A category of objects: a template mesh, its key points and its shape space."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np

from meshslam.errors import CategoryError
from meshslam.files import arrays_from_bytes, arrays_to_bytes, remove_leftovers_of, write_atomically
from meshslam.geometry import AnyArray, Floats, Ints

FORMAT = "meshslam-category-1"
FIELDS = ("vertices", "faces", "modes", "mirror", "keypoint_names", "keypoint_weights", "wheel_vertices")


@dataclass(frozen=True, eq=False)
class Category:
    """What all objects of a category share.

    Frame: x forward, y left, z up, metres, origin at the centre of the mean mesh's bounding box. The mean and each
    mode are exactly symmetric in y -> -y. A shape is `vertices + sum_m z_m modes[m]` with z ~ N(0, I).
    """

    name: str
    vertices: Floats  # (V, 3) mean mesh
    faces: Ints  # (F, 3), counter-clockwise seen from outside
    modes: Floats  # (M, V, 3), each scaled by its standard deviation
    mirror: Ints  # (V,) index of each vertex's mirror image; a vertex of the plane is its own
    keypoint_names: tuple[str, ...]
    keypoint_weights: Floats  # (K, V), rows sum to 1
    wheel_vertices: Ints  # vertices that touch the ground

    def __post_init__(self) -> None:
        for complaint in _complaints(self):
            raise CategoryError(f"category {self.name!r}: {complaint}")

    def shape(self, z: Floats) -> Floats:
        """Vertices (V, 3) at mode weights z (M,); fewer weights than modes leave the rest at zero."""
        weights = np.asarray(z, float)
        if weights.ndim != 1 or len(weights) > len(self.modes):
            raise CategoryError(f"z holds up to {len(self.modes)} mode weights, found shape {weights.shape}")
        return self.vertices + np.tensordot(weights, self.modes[: len(weights)], axes=1)

    def keypoints(self, vertices: Floats) -> Floats:
        """Key points (K, 3) of a mesh (V, 3) of this topology, in its frame (the paper's V A, transposed)."""
        points: Floats = self.keypoint_weights @ vertices
        return points

    @property
    def dimensions(self) -> tuple[float, float, float]:
        """Length, width and height of the mean mesh, metres."""
        length, width, height = np.ptp(self.vertices, axis=0)
        return float(length), float(width), float(height)


def category_names() -> tuple[str, ...]:
    """Names of the categories that the package ships."""
    files = resources.files("meshslam.categories").joinpath("data").iterdir()
    return tuple(sorted(f.name.removesuffix(".npz") for f in files if f.name.endswith(".npz")))


def load_category(name: str | Path) -> Category:
    """Load a shipped category by its name, or any by its file's path (.npz); CategoryError says what is wrong."""
    if isinstance(name, Path) or str(name).endswith(".npz"):
        path = Path(name)
        if not path.is_file():
            raise CategoryError(f"no category file at {path}")
        return _read(path.read_bytes(), str(path))
    if name not in category_names():
        raise CategoryError(f"no category {name!r}: shipped are {', '.join(category_names())}; or give a .npz file")
    file = resources.files("meshslam.categories").joinpath("data", f"{name}.npz")
    return _read(file.read_bytes(), f"{name}.npz")


def save_category(category: Category, path: Path) -> None:
    """Write `path` (.npz, floats as float32, fixed time stamps: the same category gives the same bytes).

    CategoryError if the disk does not take it; a file that was there before then stays.
    """
    remove_leftovers_of(Path(path))
    write_atomically(Path(path), category_bytes(category), CategoryError)


def category_bytes(category: Category) -> bytes:
    """The bytes that `save_category` writes."""
    arrays: dict[str, AnyArray] = {"format": np.array(FORMAT), "name": np.array(category.name)}
    for field in FIELDS:
        array = np.asarray(getattr(category, field))
        small = {"f": np.float32, "i": np.int32}.get(array.dtype.kind)
        arrays[field] = array.astype(small) if small else array
    return arrays_to_bytes(arrays)


def _read(data: bytes, origin: str) -> Category:
    try:
        arrays: dict[str, AnyArray] = arrays_from_bytes(data, _MAX_BYTES)
    except ValueError as error:
        raise CategoryError(f"{origin}: {error}") from error
    missing = [key for key in ("format", "name", *FIELDS) if key not in arrays]
    if missing:
        raise CategoryError(f"{origin}: key {missing[0]!r} is missing; a category file holds {', '.join(FIELDS)}")
    if str(arrays["format"]) != FORMAT:
        raise CategoryError(f"{origin}: format {str(arrays['format'])!r} found, {FORMAT!r} expected")
    try:
        return _from_arrays(arrays)
    except (TypeError, ValueError) as error:
        raise CategoryError(f"{origin}: {error}") from error
    except CategoryError as error:
        raise CategoryError(f"{origin}: {error}") from None


_MAX_BYTES = 256 << 20  # of all arrays; the shipped categories have 0.5 MB


def _from_arrays(arrays: dict[str, AnyArray]) -> Category:
    weights = np.asarray(arrays["keypoint_weights"], np.float64)
    return Category(
        name=str(arrays["name"]),
        vertices=np.asarray(arrays["vertices"], np.float64),
        faces=np.asarray(arrays["faces"], np.int64),
        modes=np.asarray(arrays["modes"], np.float64),
        mirror=np.asarray(arrays["mirror"], np.int64),
        keypoint_names=tuple(str(n) for n in arrays["keypoint_names"]),
        keypoint_weights=weights / weights.sum(1, keepdims=True),
        wheel_vertices=np.asarray(arrays["wheel_vertices"], np.int64),
    )


def _complaints(category: Category) -> list[str]:
    """What is wrong with a category, the first thing first."""
    v, shapes = len(category.vertices), _shape_complaints(category)
    if shapes:
        return shapes
    found = [f"{f} holds NaN or infinity" for f in ("vertices", "modes", "keypoint_weights") if _wild(category, f)]
    for field in ("faces", "mirror", "wheel_vertices"):
        indices = getattr(category, field)
        if indices.size and (indices.min() < 0 or indices.max() >= v):
            found.append(f"{field} names vertices {indices.min()} to {indices.max()}, there are {v}")
    if found:
        return found
    if (category.mirror[category.mirror] != np.arange(v)).any():
        found.append("mirror is no involution: the mirror image of a mirror image must be the vertex itself")
    else:
        flip = np.array([1.0, -1.0, 1.0])
        found += [
            f"{field} are not symmetric in y -> -y"
            for field in ("vertices", "modes")
            if (
                np.abs(getattr(category, field)[..., category.mirror, :] * flip - getattr(category, field)) > 1e-9
            ).any()
        ]
    if (np.abs(category.keypoint_weights.sum(1) - 1) > 1e-6).any():
        found.append("rows of keypoint_weights must sum to 1")
    return found


def _shape_complaints(category: Category) -> list[str]:
    v, k = len(category.vertices), len(category.keypoint_names)
    expected: dict[str, tuple[int | None, ...]] = {
        "vertices": (None, 3),
        "faces": (None, 3),
        "modes": (None, v, 3),
        "mirror": (v,),
        "keypoint_weights": (k, v),
        "wheel_vertices": (None,),
    }
    found = []
    for field, shape in expected.items():
        actual = getattr(category, field).shape
        if len(actual) != len(shape) or any(e not in (None, a) for a, e in zip(actual, shape, strict=True)):
            found.append(f"{field} has shape {actual}, expected {tuple('any' if e is None else e for e in shape)}")
    return found or ([] if v and len(category.faces) else ["it has no vertices or no faces"])


def _wild(category: Category, field: str) -> bool:
    return not bool(np.isfinite(getattr(category, field)).all())
