"""Names of classes: compared without regard to case, and taken for others where the file or its user says so."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from meshslam.errors import ConfigError
from meshslam.perception.coco import COCO_CLASSES, VEHICLES
from meshslam.perception.detections import CategoryEntry, DetectionSet
from meshslam.perception.faults import Faults
from meshslam.perception.json_values import quoted

SETTING = "input.category_names"
_USUAL = {  # what other data sets call our categories
    "car": ("vehicle", "vehicles", "cars", "automobile", "sedan", "passenger car", "vehicle.car"),
    "truck": ("trucks", "lorry", "vehicle.truck"),
    "bus": ("buses", "vehicle.bus", "vehicle.bus.rigid"),
}
GUESSES = {name: ours for ours, names in _USUAL.items() for name in names}


@dataclass(frozen=True)
class ClassNames:
    """Categories as they are used, no two of one name; and the name for each category id of the file."""

    entries: tuple[CategoryEntry, ...]
    of_category: Mapping[int, str]


def renamings(given: Sequence[str]) -> dict[str, str]:
    """What `input.category_names` says, such as `vehicle=car`: our names by the file's, in small letters."""
    found = {}
    for entry in given:
        theirs, equals, ours = (part.strip() for part in entry.partition("="))
        if not theirs or not equals or not ours:
            raise ConfigError(f"{SETTING}: found {quoted(entry)}, expected such as vehicle=car")
        found[theirs.lower()] = ours
    return found


def our_names(given: Mapping[str, str] | None) -> dict[str, str]:
    """The same from a mapping, as Python's callers give it: {"vehicle": "car"}."""
    if given is not None and not isinstance(given, Mapping):
        raise ConfigError(f"classes: found {quoted(str(given))}, expected a mapping such as {{'vehicle': 'car'}}")
    return renamings([f"{theirs}={ours}" for theirs, ours in (given or {}).items()])


def unknown_renaming(renamed: Mapping[str, str], names: Collection[str]) -> str | None:
    """What to tell where a class is to be renamed that is not there; None otherwise."""
    small = {name.strip().lower() for name in names}
    unknown = [theirs for theirs in renamed if theirs not in small]
    there = ", ".join(quoted(name)[1:-1] for name in list(dict.fromkeys(names))[:6]) or "none"
    return f"{SETTING}: no class {quoted(unknown[0])}, there are {there}"[:200] if unknown else None


def canonical_names(
    categories: Sequence[CategoryEntry], renamed: Mapping[str, str] | None, tracked: Collection[str], faults: Faults
) -> ClassNames:
    """Names as they are used; with `renamed` None as they stand in the file.

    A class that data sets call by another name, such as `vehicle`, is taken for ours unless the file has ours too, or
    the name is itself one of those `tracked`.
    Categories that become one are joined; their key points must agree.
    """
    used = {c.id: c.name for c in categories}
    if renamed is not None:
        used = {c.id: renamed.get(c.name.lower(), _known_spelling(c.name, tracked)) for c in categories}
        used = _guessed(used, {*renamed.values(), *tracked}, faults)
        _tell(categories, used, faults)
    by_name: dict[str, CategoryEntry] = {}
    for category in categories:
        entry, name = replace(category, name=used[category.id]), used[category.id]
        there = by_name.setdefault(name, entry)
        if there is not entry:
            by_name[name] = _joined(there, entry, category, renamed, faults)
    return ClassNames(tuple(by_name.values()), used)


def renamed_set(found: DetectionSet, renamed: Mapping[str, str], where: str) -> DetectionSet:
    """The detections with classes that are others of ours; ConfigError where one is not there."""
    names = {c.name: renamed.get(c.name.lower(), c.name) for c in found.categories}
    unknown = unknown_renaming(renamed, tuple(names))
    if unknown is not None:
        raise ConfigError(f"{where}: {unknown}")
    categories = {names[c.name]: replace(c, name=names[c.name]) for c in reversed(found.categories)}
    detections = tuple(replace(d, category=names[d.category]) for d in found.detections)
    return replace(found, categories=tuple(reversed(categories.values())), detections=detections)


def untracked(found: DetectionSet, tracked: Collection[str]) -> str | None:
    """What to tell where there are detections but none is of a class that is tracked; None otherwise."""
    counts = Counter(d.category for d in found.detections)
    if not counts or any(name in tracked for name in counts):
        return None
    names = ", ".join(f"{quoted(name)} ({n})" for name, n in counts.most_common(3))
    more = f" and {len(counts) - 3} more" if len(counts) > 3 else ""
    first = quoted(counts.most_common(1)[0][0])[1:-1]
    return (
        f"no detection has a class that is tracked (tracking.categories: {', '.join(sorted(tracked))[:60]}): found "
        f"{names}{more}; {SETTING}: [{first}=car] reads a class as another"
    )


def _known_spelling(name: str, tracked: Collection[str]) -> str:
    """A tracked class as it is tracked, another known one in small letters; any other name as it is."""
    small = name.strip().lower()
    for ours in tracked:
        if ours.lower() == small:
            return ours
    return small if small in VEHICLES or small in COCO_CLASSES or small in GUESSES else name


def _guessed(used: Mapping[int, str], meant: Collection[str], faults: Faults) -> dict[int, str]:
    """Names with guesses for those that nobody means; a guess is made for one name of the file at most."""
    there, found = set(used.values()), {}
    for id_, name in used.items():
        ours = GUESSES.get(name)
        guess = ours is not None and ours not in there and name not in meant
        found[id_] = ours if guess and ours is not None else name
        if guess and ours is not None:
            there.add(ours)
            faults.note(f"category {quoted(name)} is taken for {ours} ({SETTING}: [{name}=...] would say another)")
    return found


def _tell(categories: Sequence[CategoryEntry], used: Mapping[int, str], faults: Faults) -> None:
    for category in categories:
        name = used[category.id]
        if name not in (category.name, GUESSES.get(category.name.strip().lower())):
            faults.note(f"category {quoted(category.name)} is read as {quoted(name)}")


def _joined(
    one: CategoryEntry,
    other: CategoryEntry,
    category: CategoryEntry,
    renamed: Mapping[str, str] | None,
    faults: Faults,
) -> CategoryEntry:
    if renamed is None or category.name.lower() not in renamed:
        faults.add("categories", f"names must differ, also without regard to case; {quoted(one.name)} comes twice")
    elif one.keypoints and other.keypoints and one.keypoints != other.keypoints:
        faults.add("categories", f"{quoted(category.name)} and {quoted(one.name)} become one, but key points differ")
    return one if one.keypoints else other
