"""What the user should know of a merge, and its figures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from meshslam.merging.config import MergingConfig
from meshslam.merging.links import Linking
from meshslam.merging.moves import MergedCar
from meshslam.merging.result import LaidDrive, Merged, World

_LISTED = 8  # names in a note
_MOST_MOVED = 0.3  # of a drive's cars: of more it is the drive that is bent


def notes_of(found: Merged, linking: Linking, config: MergingConfig) -> tuple[str, ...]:
    """Sentences: what was laid where, what could not be, which cars moved, which drives are bent."""
    return (
        *_laid(found),
        *_alone(found, linking),
        *(note for world in found.worlds for note in _of_cars(found, world)),
        *_bent(found, config),
    )


def figures_of(found: Merged) -> dict[str, float]:
    """Figures of the first world, and the number of worlds, as metrics.json names them."""
    first = found.worlds[0]
    shared = [car for car in first.cars if len(car.seen_in) > 1]
    gaps = np.concatenate([np.zeros(0), *(drive.residuals_m for drive in first.drives)])
    sigmas = [laid.sigmas_at(first.middle_of(found, laid))[0] for laid in first.drives]
    rows: dict[str, float] = {
        "drives": len(found.drives),
        "worlds": len(found.worlds),
        "drives_in_world": len(first.drives),
        "objects_mapped": len(first.standing),
        "cars_of_several_drives": len(shared),
        "cars_moved": sum(car.status == "moved" for car in first.cars),
        "cars_gone": sum(car.status == "gone" for car in first.cars),
        "cars_new": sum(car.status == "new" for car in first.cars),
        "alignment_sigma_max_m": max(sigmas, default=0.0),
        "alignment_residual_median_m": float(np.median(gaps)) if len(gaps) else 0.0,
    }
    return {key: round(value, 6) for key, value in rows.items()}


def _laid(found: Merged) -> Iterator[str]:
    for world in found.worlds:
        home = found.drives[world.drives[0].index].name
        for laid in world.drives[1:]:
            yield f"{found.drives[laid.index].name}: laid into the world of {home} by {_by(laid)}"


def _by(laid: LaidDrive) -> str:
    if laid.how == "given":
        return "the poses that were given: it shares no car with another drive"
    pose, away = laid.world_from_drive, float(np.median(laid.residuals_m)) if len(laid.residuals_m) else 0.0
    turn = float(np.degrees(pose.yaw_rad))
    shift = ", ".join(f"{value:.2f}" for value in pose.translation)
    return (
        f"{laid.shared_cars} cars that it shares with others: turned by {turn:.2f} deg, moved by ({shift}) m; "
        f"the cars are {100 * away:.0f} cm apart in the median"
    )


def _alone(found: Merged, linking: Linking) -> Iterator[str]:
    """Why a world does not hang together with the first."""
    if len(found.worlds) < 2:
        return
    first = {laid.index for laid in found.worlds[0].drives}
    for k, world in enumerate(found.worlds[1:], 2):
        names = ", ".join(found.drives[laid.index].name for laid in world.drives)
        own = {laid.index for laid in world.drives}
        why = [
            (found.drives[min(pair)].name, found.drives[max(pair)].name, reason)
            for pair, reason in sorted(linking.refused.items())
            if (pair[0] in own) != (pair[1] in own) and (pair[0] in first or pair[1] in first)
        ]
        told = "; ".join(f"{a} and {b}: {reason}" for a, b, reason in why[:_LISTED])
        yield f"{names}: not laid on the others, kept in world-{k} ({told})"


def _of_cars(found: Merged, world: World) -> Iterator[str]:
    for car in world.cars:
        if car.status == "moved":
            apart = max((v.apart_m or 0.0 for v in car.visits if v.status == "moved"), default=0.0)
            before = [found.drives[v.drive].name for v in car.visits if v.status == "moved"]
            yield f"car {car.thing.id}: moved by {apart:.2f} m since {', '.join(before)}"
        elif car.status == "gone":
            yield f"car {car.thing.id}: gone since {_first_gone(found, car)}: its place was in view there"
    new = [str(car.thing.id) for car in world.cars if car.status == "new"]
    if new:
        more = ", …" if len(new) > _LISTED else ""
        yield f"new since an earlier drive, which saw their places without them: {', '.join(new[:_LISTED])}{more}"


def _first_gone(found: Merged, car: MergedCar) -> str:
    gone: Sequence[int] = [v.drive for v in car.visits if v.status == "gone"]
    return found.drives[min(gone)].name


def _bent(found: Merged, config: MergingConfig) -> Iterator[str]:
    """Drives whose cars do not fit the others' by one rigid motion."""
    for world in found.worlds:
        for laid in world.drives:
            moved = sum(any(v.drive == laid.index and v.status == "moved" for v in car.visits) for car in world.cars)
            strange = laid.mean_error > config.bent_share or moved > max(2, _MOST_MOVED * laid.shared_cars)
            if strange and laid.shared_cars > 2:
                yield (
                    f"{found.drives[laid.index].name}: its cars lie {100 * float(np.median(laid.residuals_m)):.0f} cm "
                    f"(median) and up to {100 * float(laid.residuals_m.max()):.0f} cm from where all drives have them, "
                    f"and {moved} seem to have moved (mean squared residual {laid.mean_error:.1f} variances): its path "
                    "is bent"
                )
