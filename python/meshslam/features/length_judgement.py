"""Which step lengths of given poses are wrong, and what they are instead: only where independent sources agree."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from meshslam.features.image_path import ImagePath, step_lengths_m
from meshslam.features.length_config import LengthConfig
from meshslam.features.length_evidence import LogFactor, agreement, drift, white_sigma, wrong_steps
from meshslam.geometry import Bools, Floats, Ints, Pose

_MOST, _SOME = 2 / 3, 1 / 3  # of the given lengths that are right, so that they tell the unit; alone, and with the road
_ALIKE, _CONTRARY = 2.0, 3.0  # sigmas
_NOISY = 2.0  # times the sigma of right lengths
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
    def _own_sigmas(self) -> Floats:
        """Of the given lengths (n,), if they are right."""
        return np.asarray(np.hypot(self.config.given_share, self.config.given_sigma_m / self.lengths_m), float)

    @cached_property
    def _information(self) -> Floats:
        return self.by_images.information / self.config.point_inflation**2

    @cached_property
    def _agreement(self) -> tuple[Floats, Bools]:
        found = agreement(self.by_images.log_ratios, self._information, self._own_sigmas, self.road)
        return found.log_ratios, wrong_steps(found, self.config.min_sigmas, self.config.min_share)

    @property
    def log_ratios(self) -> Floats:
        """Logarithms (n,) of true over given lengths, if most of the given ones are right."""
        return self._agreement[0]

    @property
    def wrong(self) -> Bools:
        """Which given lengths (n,) contradict the others then."""
        return self._agreement[1]

    @cached_property
    def noise(self) -> float:
        """Sigma of the given lengths' logarithms from step to step."""
        return white_sigma(self.by_images.log_ratios)

    @property
    def is_noisy(self) -> bool:
        """Whether the given lengths are noise throughout, and not right but for a few."""
        return self.noise > _NOISY * float(np.median(self._own_sigmas))

    @cached_property
    def drifts(self) -> bool:
        """Whether the given lengths go wrong little by little, those of `wrong` apart."""
        sigmas, usable = np.maximum(self._own_sigmas, self.noise), ~self.wrong
        found = drift(self.by_images.log_ratios, self._information, sigmas, usable)
        if found is None:
            return False
        least = 2 * float(np.log1p(self.config.min_share))
        return abs(found.value) > max(least, self.config.min_sigmas * found.sigma)

    @property
    def is_right(self) -> bool:
        """Whether points contradict none of the given lengths."""
        return not self.wrong.any() and not self.drifts

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
        return not self.drifts and not self.is_noisy and (share >= _MOST or (share >= _SOME and agrees))

    @property
    def mean_factor(self) -> LogFactor:
        """Of true over the images' lengths, by the given way from the first camera to the last: noise is small."""
        way, by_images = (_way_m(poses) for poses in (self.given, self.by_images.world_from_camera))
        sigma = self.noise * float(self.lengths_m.mean()) / max(way, 1e-9)
        return LogFactor(float(np.log(max(way, 1e-9) / max(by_images, 1e-9))), max(sigma, self.config.given_share))


def _way_m(poses: Sequence[Pose]) -> float:
    return float(np.linalg.norm(poses[-1].translation - poses[0].translation))


@dataclass(frozen=True, eq=False)
class Correction:
    """New displacements of some steps; `note` is what the user should know."""

    note: str
    steps: tuple[int, ...] = ()  # k is the one from frame k to k + 1
    displacements_m: Floats | None = None  # (len(steps), 3) in the world


def judge_stretch(stretch: Stretch, sizes: Sizes) -> Correction | None:
    """What is wrong with a stretch whose given lengths points contradict; None if they do not.

    Where most are right, the others are corrected. Where all are noisy, their ratios are, and the way of all stays.
    Where too many are wrong, the road tells the unit, and the sizes of cars must agree.
    """
    if stretch.is_right:
        return None
    count, by_images = len(stretch.wrong), stretch.by_images.log_ratios
    if stretch.tells_unit:
        which = np.flatnonzero(stretch.wrong)
        said = f"{len(which)} of {count} given step lengths contradict tracked points and the others"
        return _corrected(stretch, which, stretch.log_ratios, said)
    said = f"tracked points contradict the ratios of the step lengths (by {_percent(float(np.ptp(by_images)))})"
    if stretch.is_noisy and not stretch.drifts:
        factor, how = _of_noisy(stretch.mean_factor, stretch.road)
    else:
        factor, how = _absolute(stretch, sizes)
    if factor is None:
        return Correction(f"camera path, {_frames(stretch)}: {said}, {how}: nothing was corrected")
    return _corrected(stretch, np.arange(count), by_images + factor.value, f"{said}, {how}")


def _of_noisy(mean: LogFactor, road: LogFactor | None) -> tuple[LogFactor | None, str]:
    """The factor by the way of all steps and the road, and how it is told; None where these contradict each other."""
    if road is None:
        return mean, "they are noisy, their sum tells the unit"
    if mean.sigmas_from(road) > _CONTRARY:
        return None, "they are noisy, and the road's texture contradicts their sum"
    return mean.of(road), "they are noisy, their sum agrees with the road's texture"


def _absolute(stretch: Stretch, sizes: Sizes) -> tuple[LogFactor | None, str]:
    """True over the images' lengths by road and cars, and how it is told; None if they do not tell it."""
    road = stretch.road
    if road is None:
        return None, "the road does not tell the right ones"
    cars = sizes(scaled(stretch.by_images.world_from_camera, road.value))
    if cars is None:
        return road, "the road's texture tells the unit"
    if abs(cars.value) > _CONTRARY * float(np.hypot(cars.sigma, road.sigma)):
        return None, "road and sizes of cars do not agree"
    found = road.of(LogFactor(road.value + cars.value, cars.sigma, cars.count))
    return found, f"the sizes of {cars.count} cars agree with the road's texture"


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
    what = f"{len(which)} step length{'s' if len(which) > 1 else ''} corrected, {before:.2f} m to {after:.2f} m"
    note = f"camera path, {_frames(stretch)}: {said}: {what}"
    return Correction(note, tuple((stretch.first + which).tolist()), np.round(moved[which], 9))


def _frames(stretch: Stretch) -> str:
    return f"frames {stretch.first} to {stretch.last}"


def _times(factor: LogFactor) -> str:
    return f"{np.exp(factor.value):.2f} ± {factor.sigma:.2f}"


def _percent(log_ratio: float) -> str:
    return f"{100 * np.expm1(log_ratio):.0f}%"
