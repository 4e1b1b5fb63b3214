"""What a stretch of a drive says of its step lengths: images against given poses; the road's texture for the unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from meshslam.features.image_features import FrameImage
from meshslam.features.road_displacement import RoadConfig, road_displacement_m, road_normal
from meshslam.geometry import Bools, Camera, Floats, Pose

_KERNEL = 3.0  # Geman and McClure's threshold, in sigmas
_STARTS, _ROUNDS, _ENOUGH = 25, 50, 1e-9
_MIN_FOR_NOISE = 5  # steps
_MIN_PAIRS, _MIN_SHARE = 3, 0.5  # of the pairs of frames that the road is compared in
_PAIRS_ALIKE = 3.0  # pairs that overlap: one of so many counts


@dataclass(frozen=True)
class LogFactor:
    """The logarithm of true over assumed lengths."""

    value: float
    sigma: float
    count: int = 1  # of what told it

    def of(self, other: LogFactor) -> LogFactor:
        """Both together: weighted by their variances."""
        a, b = self.sigma**-2, other.sigma**-2
        return LogFactor((a * self.value + b * other.value) / (a + b), float((a + b) ** -0.5), self.count + other.count)

    def sigmas_from(self, other: LogFactor) -> float:
        """How far apart both are, in sigmas of the difference."""
        return abs(self.value - other.value) / float(np.hypot(self.sigma, other.sigma))


@dataclass(frozen=True, eq=False)
class Agreement:
    """Step lengths by points, with the common factor at which most given ones are right."""

    log_ratios: Floats  # (n,) of true over given lengths
    sigmas: Floats  # (n,) of these, with the given lengths' own


def agreement(
    log_ratios: Floats, information: Floats, given_sigmas: Floats, unit: LogFactor | None = None
) -> Agreement:
    """The logarithms (n,) by points of `information` (n, n) and by given lengths, each right or wrong at all.

    min over x of (x - l)^T A (x - l) / 2 + sum rho(x_i / sigma_i), rho Geman and McClure's. Points leave x + c free:
    the search begins with each c that makes one given length right, and the lowest cost is taken. There `unit`, what
    else is known of c, counts as much as one given length.
    """
    order = np.sort(-log_ratios)
    starts = order[np.unique(np.linspace(0, len(order) - 1, min(len(order), _STARTS)).round().astype(int))]
    found = [_settled(log_ratios + c, log_ratios, information, given_sigmas) for c in (0.0, *starts.tolist())]

    def cost(one: tuple[float, Floats, Floats]) -> float:
        told = 0.0 if unit is None else (float(np.mean(one[1] - log_ratios)) - unit.value) / unit.sigma
        return one[0] + float(_rho(np.array(told**2)))

    _, x, normal = min(found, key=cost)
    variance = np.linalg.inv(normal).diagonal()
    return Agreement(x, np.sqrt(variance + given_sigmas**2))


def _rho(squares: Floats) -> Floats:
    """Geman and McClure's cost of squared residuals (...), in sigmas."""
    found: Floats = 0.5 * _KERNEL**2 * squares / (_KERNEL**2 + squares)
    return found


def _settled(x: Floats, log_ratios: Floats, information: Floats, sigmas: Floats) -> tuple[float, Floats, Floats]:
    """Weighted least squares again and again from x; the cost, x and the normal matrix there."""
    right, square = information @ log_ratios, _KERNEL**2

    def normal(x: Floats) -> Floats:
        weights = (square / (square + (x / sigmas) ** 2)) ** 2
        return np.asarray(information + np.diag(np.maximum(weights, 1e-9) / sigmas**2), float)

    for _ in range(_ROUNDS):
        before, x = x, np.asarray(np.linalg.solve(normal(x), right), float)
        if float(np.abs(x - before).max()) < _ENOUGH:
            break
    gap = x - log_ratios
    cost = 0.5 * float(gap @ information @ gap) + float(_rho((x / sigmas) ** 2).sum())
    return cost, x, normal(x)


def white_sigma(log_ratios: Floats) -> float:
    """Sigma of what differs from step to step: by second differences, which no drift and few outliers change."""
    if len(log_ratios) < _MIN_FOR_NOISE:
        return 0.0
    return 1.4826 * float(np.median(np.abs(np.diff(log_ratios, 2)))) / float(np.sqrt(6))


def drift(log_ratios: Floats, information: Floats, sigmas: Floats, usable: Bools) -> LogFactor | None:
    """Change of logarithms (n,) from the first to the last, by a straight line through the usable ones; None for < 3.

    They are known with `information` (n, n) by points, up to a constant, and the given lengths with `sigmas` (n,).
    """
    if int(usable.sum()) < 3:
        return None
    free = np.linalg.inv(information + np.eye(len(sigmas))) + np.diag(sigmas**2)  # a constant may be anything
    inverse = np.linalg.inv(free[np.ix_(usable, usable)])
    line = np.stack([np.ones(len(sigmas)), np.linspace(-0.5, 0.5, len(sigmas))], axis=1)[usable]
    covariance = np.linalg.inv(line.T @ inverse @ line)
    found = covariance @ line.T @ inverse @ log_ratios[usable]
    return LogFactor(float(found[1]), float(np.sqrt(covariance[1, 1])), int(usable.sum()))


def wrong_steps(found: Agreement, sigmas: float, least: float) -> Bools:
    """Which given lengths (n,) differ by more than so many sigmas, and by a share that matters."""
    return np.asarray(np.abs(found.log_ratios) > np.maximum(sigmas * found.sigmas, np.log1p(least)), bool)


def road_factor(
    images: Sequence[FrameImage],
    world_from_camera: Sequence[Pose],
    camera: Camera,
    height_m: float,
    share: float,
    config: RoadConfig,
) -> LogFactor | None:
    """The factor of a path's lengths by the road's texture under it; None where that tells nothing.

    `share` is the sigma of what all pairs of frames have in common: the camera's height and the road's slope.
    """
    centres = [pose.translation for pose in world_from_camera]
    tried, logs = 0, []
    for j in range(1, len(centres)):
        away = np.linalg.norm(np.array(centres[:j]) - centres[j], axis=1)
        far = np.flatnonzero(away >= config.min_baseline_m)
        if not len(far):
            continue
        i, tried = int(far[-1]), tried + 1
        normal = _normal(centres[i:], config)
        if normal is None:
            continue
        grey, cameras = (images[i].image, images[j].image), (world_from_camera[i], world_from_camera[j])
        found = road_displacement_m(grey, images[j].free, cameras, normal, height_m, camera, config)
        if found is not None:
            logs.append(float(np.log(found / away[i])))
    if len(logs) < max(_MIN_PAIRS, _MIN_SHARE * tried):
        return None
    middle = float(np.median(logs))
    spread = 1.4826 * float(np.median(np.abs(np.array(logs) - middle)))
    own = spread / np.sqrt(max(len(logs) / _PAIRS_ALIKE, 1.0))
    return LogFactor(middle, float(np.hypot(share, own)), len(logs))


def _normal(centres: Sequence[Floats], config: RoadConfig) -> Floats | None:
    """The road's normal along the path from here on, which may end soon."""
    ahead = np.linalg.norm(np.array(centres) - centres[0], axis=1)
    chord = min(config.chord_m, float(ahead.max()))
    return road_normal(centres, replace(config, chord_m=0.999 * chord)) if chord >= config.min_baseline_m else None
