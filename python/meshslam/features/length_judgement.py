"""Which step lengths of given poses are wrong, and what they are instead: only where independent sources agree."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from meshslam.features.image_path import ImagePath, step_lengths_m
from meshslam.features.length_config import LengthConfig
from meshslam.features.length_evidence import LogFactor, agreement, wrong_steps
from meshslam.geometry import Bools, Floats, Ints, Pose

_MOST, _SOME = 2 / 3, 1 / 3  # of the given lengths that are right, so that they tell the unit; alone, and with the road
_ALIKE, _CONTRARY = 2.0, 3.0  # sigmas
_ODDS = 3.0  # logarithm, by which the cars' sizes must speak for the road's factor

Sizes = Callable[[Sequence[Pose]], LogFactor | None]  # of true over these lengths, by the sizes of cars


@dataclass(frozen=True, eq=False)
class Stretch:
    """A part of the path, frames `first` to `last`, as given and as its images show it."""

    first: int
    last: int
    given: tuple[Pose, ...]
    by_images: ImagePath
    road: LogFactor | None  # of true over `by_images`' lengths
    config: LengthConfig

    @cached_property
    def lengths_m(self) -> Floats:
        """The given lengths (n,)."""
        return step_lengths_m(self.given)

    @cached_property
    def _agreement(self) -> tuple[Floats, Bools]:
        own = np.hypot(self.config.given_share, self.config.given_sigma_m / self.lengths_m)
        information = self.by_images.information / self.config.point_inflation**2
        found = agreement(self.by_images.log_ratios, information, own)
        return found.log_ratios, wrong_steps(found, self.config.min_sigmas, self.config.min_share)

    @property
    def log_ratios(self) -> Floats:
        """Logarithms (n,) of true over given lengths, if most of the given ones are right."""
        return self._agreement[0]

    @property
    def wrong(self) -> Bools:
        """Which given lengths (n,) contradict the others then."""
        return self._agreement[1]

    @property
    def road_and_given(self) -> LogFactor | None:
        """The road's factor for the given lengths, those of `wrong` replaced."""
        if self.road is None:
            return None
        shift = float(np.mean(self.log_ratios - self.by_images.log_ratios))
        return LogFactor(self.road.value - shift, self.road.sigma, self.road.count)

    @property
    def tells_unit(self) -> bool:
        """Whether so many of the given lengths are right that they tell the unit of the others."""
        share, road = 1.0 - float(self.wrong.mean()), self.road_and_given
        agrees = road is not None and abs(road.value) <= _ALIKE * road.sigma
        return share >= _MOST or (share >= _SOME and agrees)


@dataclass(frozen=True, eq=False)
class Correction:
    """New displacements of some steps; `note` is what the user should know."""

    note: str
    steps: tuple[int, ...] = ()  # k is the one from frame k to k + 1
    displacements_m: Floats | None = None  # (len(steps), 3) in the world


def judge_stretch(stretch: Stretch, sizes: Sizes) -> Correction | None:
    """What is wrong with a stretch whose given lengths contradict each other; None if they do not."""
    if not stretch.wrong.any():
        return None
    if stretch.tells_unit:
        which = np.flatnonzero(stretch.wrong)
        said = f"{len(which)} of {len(stretch.wrong)} steps contradict tracked points and the other steps"
        return _corrected(stretch, which, stretch.log_ratios, said)
    where, spread = f"camera path, {_frames(stretch)}", _percent(float(np.ptp(stretch.by_images.log_ratios)))
    said = f"tracked points contradict the ratios of the step lengths (by {spread})"
    if stretch.road is None:
        return Correction(f"{where}: {said}, the road does not tell the right ones: nothing was corrected")
    factor = stretch.road
    by_cars = sizes(scaled(stretch.by_images.world_from_camera, factor.value))
    if by_cars is not None:
        if abs(by_cars.value) > _CONTRARY * float(np.hypot(by_cars.sigma, factor.sigma)):
            return Correction(f"{where}: {said}, road and sizes of cars do not agree: nothing was corrected")
        factor = factor.of(LogFactor(factor.value + by_cars.value, by_cars.sigma, by_cars.count))
        said += f", the sizes of {by_cars.count} cars agree with the road's texture"
    else:
        said += ", the road's texture tells the unit"
    return _corrected(stretch, np.arange(len(stretch.wrong)), stretch.by_images.log_ratios + factor.value, said)


def judge_unit(stretches: Sequence[Stretch], given: Sequence[Pose], sizes: Sizes) -> tuple[float, str] | None:
    """A factor for all lengths of a path, and what to say of it; None where the road agrees with the given lengths.

    The factor is 1 where the cars' sizes do not speak for another one.
    """
    found = [road for stretch in stretches if (road := stretch.road_and_given) is not None]
    if not found:
        return None
    road = LogFactor(float(np.median([r.value for r in found])), found[0].sigma, sum(r.count for r in found))
    if abs(road.value) <= stretches[0].config.min_sigmas * road.sigma:
        return None
    cars = sizes(given)
    said = f"camera path: by the road's texture all lengths are {_times(road)} of the given ones"
    if cars is None:
        return 1.0, f"{said}, no car's size tells more: they were kept. Check the camera's height above the road"
    said += f", by the sizes of {cars.count} cars {_times(cars)}"
    odds = 0.5 * (cars.value / cars.sigma) ** 2 - 0.5 * cars.sigmas_from(road) ** 2
    if odds < _ODDS:
        return 1.0, f"{said}: they were kept. Check the camera's height above the road"
    factor = float(np.exp(road.of(cars).value))
    return factor, f"{said}: all were multiplied by {factor:.3f}"


def scaled(world_from_camera: Sequence[Pose], log_factor: float) -> tuple[Pose, ...]:
    """The same path about its first camera, e^log_factor times as long."""
    origin, factor = world_from_camera[0].translation, float(np.exp(log_factor))
    return tuple(Pose(p.rotation, origin + factor * (p.translation - origin)) for p in world_from_camera)


def _corrected(stretch: Stretch, which: Ints, log_ratios: Floats, said: str) -> Correction:
    """Steps of these indices, with directions by images and lengths by `log_ratios` (n,)."""
    centres = np.array([pose.translation for pose in stretch.by_images.world_from_camera])
    steps = np.diff(centres, axis=0)
    lengths = stretch.lengths_m * np.exp(log_ratios)
    moved = steps * (lengths / np.linalg.norm(steps, axis=1))[:, None]
    before, after = float(stretch.lengths_m[which].sum()), float(lengths[which].sum())
    note = (
        f"camera path, {_frames(stretch)}: {said}: {len(which)} step lengths corrected, {before:.2f} m to {after:.2f} m"
    )
    return Correction(note, tuple((stretch.first + which).tolist()), np.round(moved[which], 9))


def _frames(stretch: Stretch) -> str:
    return f"frames {stretch.first} to {stretch.last}"


def _times(factor: LogFactor) -> str:
    return f"{np.exp(factor.value):.2f} ± {factor.sigma:.2f}"


def _percent(log_ratio: float) -> str:
    return f"{100 * np.expm1(log_ratio):.0f}%"
