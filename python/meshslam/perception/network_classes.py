"""Names of a network's classes: the adapter's, the metadata's, or COCO's; and what they are called here."""

from __future__ import annotations

import ast
from collections.abc import Collection, Mapping
from pathlib import Path

from meshslam.errors import ModelError
from meshslam.perception.class_names import canonical_names, unknown_renaming
from meshslam.perception.coco import COCO_CLASSES, COCO_NUMBERS
from meshslam.perception.detections import CategoryEntry
from meshslam.perception.faults import Faults

NUMBERED = 91  # columns of networks that use COCO's numbers, of which 0 and ten more are no class


def names_of_metadata(path: Path, metadata: Mapping[str, str], count: int | None) -> dict[int, str]:
    """Names by class index: the metadata's `names`, COCO's for those that 80-class networks leave out.

    ModelError where some of `count` classes have none; with `count` None the metadata tell how many there are.
    """
    text = metadata.get("names", "{}")
    try:
        given = ast.literal_eval(text)
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        raise ModelError(f"{path}: metadata `names` is no dictionary: {text[:60]!r}") from None
    given = dict(enumerate(given)) if isinstance(given, list | tuple) else given
    said = given if isinstance(given, dict) else {}
    if count is None:
        count = len(said) or len(COCO_CLASSES)
    names = (dict(enumerate(COCO_CLASSES)) if count == len(COCO_CLASSES) else {}) | said
    missing = [i for i in range(count) if not isinstance(names.get(i), str)]
    if missing:
        raise ModelError(
            f"{path}: metadata `names` has no name for classes {missing[:10]} of {count}: an adapter gives `classes`"
        )
    chosen = {i: str(names[i]) for i in range(count)}
    if len(set(chosen.values())) < count:
        raise ModelError(f"{path}: metadata `names` gives one name to two classes: {list(chosen.values())[:10]}"[:300])
    return chosen


def names_of_columns(path: Path, columns: int | None) -> dict[int, str]:
    """COCO's names for 91 columns by their numbers, for 80 in order; ModelError for others, which need an adapter."""
    if columns == NUMBERED:
        return dict(COCO_NUMBERS)
    if columns == len(COCO_CLASSES):
        return dict(enumerate(COCO_CLASSES))
    raise ModelError(
        f"{path}: has {columns} classes and does not name them: give `classes` in an adapter (docs/networks.md)"
    )


def used_names(
    path: Path, names: Collection[str], renamed: Mapping[str, str] | None, tracked: Collection[str]
) -> tuple[dict[str, str], tuple[str, ...]]:
    """What a network's classes are called here, and notes; with `renamed` None they keep their names.

    As for detection files: letters' case does not count, `vehicle` is taken for car where nothing says otherwise.
    """
    if renamed is None:
        return {name: name for name in names}, ()
    faults, different = Faults(path), list(dict.fromkeys(names))
    unknown = unknown_renaming(renamed, different)
    if unknown is not None:
        raise ModelError(f"{path}: {unknown}")
    entries = tuple(CategoryEntry(i, name) for i, name in enumerate(different))
    found = canonical_names(entries, renamed, tracked, faults).of_category
    return {name: found[i] for i, name in enumerate(different)}, tuple(faults.notes)
