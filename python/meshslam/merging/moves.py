"""Cars that stood elsewhere in an earlier drive, and places whose car has gone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from meshslam.maps import MapObject
from meshslam.merging.config import MergingConfig
from meshslam.merging.places import one_size
from meshslam.merging.visits import Visit

_OVERLAP = 0.8  # of their lengths and widths: nearer, two cars cannot both stand


@dataclass(frozen=True, eq=False)
class MergedCar:
    """A car of the merged map, with what each drive says of it."""

    thing: MapObject
    visits: tuple[Visit, ...]  # one of each drive, in their order
    earlier: tuple[MapObject, ...] = ()  # where it stood before, with the number of that place

    @property
    def seen_in(self) -> tuple[int, ...]:
        """The drives that mapped it, in their order."""
        return tuple(visit.drive for visit in self.visits if visit.number is not None)

    @property
    def status(self) -> str:
        """`gone`, `moved`, `new` (an earlier drive saw its place without it), or `parked`."""
        kinds = {visit.status for visit in self.visits}
        if "gone" in kinds:
            return "gone"
        return "moved" if self.earlier else "new" if "absent" in kinds else "parked"


def told_apart(cars: Sequence[MergedCar], config: MergingConfig) -> list[MergedCar]:
    """The cars, those that stood in one place earlier and in another later joined, those that left marked as gone.

    A car has moved if its two places are nearer than `max_moved_m`, no drive saw both, none of the later drives saw the
    earlier place taken, and its size is the same; of several such places the nearest is its own.
    """
    kept, joined = list(cars), set[int]()
    pairs = sorted(
        (gap, i, j)
        for i, before in enumerate(cars)
        for j, after in enumerate(cars)
        if i != j and (gap := _moved_m(before, after, config)) is not None
    )
    taken = set[int]()
    for _, i, j in pairs:
        if i not in joined and j not in taken and j not in joined and i not in taken:
            kept[j] = _with_earlier(kept[j], kept[i])
            joined.add(i)
            taken.add(j)
    return _without_overlaps([_with_end(car) for k, car in enumerate(kept) if k not in joined])


def _moved_m(before: MergedCar, after: MergedCar, config: MergingConfig) -> float | None:
    """How far a car would have moved, if the one may be the other later."""
    if not before.seen_in or not after.seen_in or max(before.seen_in) >= min(after.seen_in):
        return None
    gap = _apart_m(before, after)
    if gap > config.max_moved_m or not one_size(before.thing, after.thing, config.size_ratio):
        return None
    later = {visit.drive: visit.status for visit in before.visits if visit.drive >= min(after.seen_in)}
    earlier = {visit.drive: visit.status for visit in after.visits if visit.drive <= max(before.seen_in)}
    left = all(later[drive] == "absent" for drive in after.seen_in) or _overlap(before, after)
    came = all(earlier[drive] != "detected" for drive in before.seen_in)
    return gap if left and came else None


def _with_earlier(after: MergedCar, before: MergedCar) -> MergedCar:
    """A car with where it stood before: those visits are `moved`."""
    gap = _apart_m(before, after)
    there = {v.drive: replace(v, status="moved", apart_m=gap) for v in before.visits if v.number is not None}
    visits = tuple(there.get(visit.drive, visit) for visit in after.visits)
    return replace(after, visits=visits, earlier=(*after.earlier, before.thing))


def _with_end(car: MergedCar) -> MergedCar:
    """After the last drive that saw it, an empty place in view means that it has gone."""
    last = max(car.seen_in, default=-1)
    ended = tuple(replace(v, status="gone") if v.status == "absent" and v.drive > last else v for v in car.visits)
    return replace(car, visits=ended)


def _without_overlaps(cars: list[MergedCar]) -> list[MergedCar]:
    """Of two cars in one place, the one that only earlier drives saw has gone, else the one that fewer drives saw."""
    left = dict(enumerate(cars))
    for i, one in enumerate(cars):
        for j, other in enumerate(cars[:i]):
            if "gone" not in (left[i].status, left[j].status) and _overlap(one, other):
                k = j if _outlasts(one, other) else i
                left[k] = _replaced(left[k], left[i if k == j else j])
    return list(left.values())


def _outlasts(one: MergedCar, other: MergedCar) -> bool:
    """Whether `one` is rather still there than `other`."""
    return (max(one.seen_in), len(one.seen_in), one.thing.views) > (
        max(other.seen_in),
        len(other.seen_in),
        other.thing.views,
    )


def _replaced(car: MergedCar, by: MergedCar) -> MergedCar:
    """A car in whose place another stands: it is gone in the drives that saw that one."""
    visits = tuple(
        replace(v, status="gone", frames=0) if v.drive in by.seen_in and v.number is None else v for v in car.visits
    )
    if all(v.status != "gone" for v in visits):  # both were seen by the same drives: the worse of two estimates
        visits = tuple(replace(v, status="gone") if v.number is not None else v for v in visits)
    return replace(car, visits=visits)


def _overlap(one: MergedCar, other: MergedCar) -> bool:
    """Whether two cars would stand in each other, as boxes along the first one's axes."""
    apart = np.abs(one.thing.world_from_object.inverse().transform(other.thing.world_from_object.translation))
    return bool((apart[:2] < _OVERLAP * (one.thing.dimensions + other.thing.dimensions)[:2] / 2).all())


def _apart_m(one: MergedCar, other: MergedCar) -> float:
    """Distance of two cars on the ground."""
    gap = one.thing.world_from_object.translation - other.thing.world_from_object.translation
    return float(np.linalg.norm(gap[:2]))
