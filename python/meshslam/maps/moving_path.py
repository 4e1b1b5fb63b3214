"""The path of an object that drives, and its files: poses with velocity and uncertainty (CSV), poses alone (TUM)."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from meshslam.errors import GeometryError, MapError
from meshslam.geometry import Floats, Pose
from meshslam.maps.trajectory_estimate import writable
from meshslam.sequences import format_tum

_UPPER = [(i, j) for i in range(6) for j in range(i, 6)]
_POSE = ("timestamp", "frame", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
_COVARIANCE = tuple(f"c{i}{j}" for i, j in _UPPER)
_DRIVING = ("vx", "vy", "vz", "speed_m_s", "speed_sigma_m_s", "turn_rate_rad_s", "turn_rate_sigma_rad_s")
COLUMNS = (*_POSE, *_COVARIANCE, *_DRIVING)


@dataclass(frozen=True, eq=False)
class MovingPath:
    """Where an object was at each time, and how it drove; MapError if the numbers of rows differ.

    `covariances[i]` is that of a right perturbation of `world_from_object[i]`: (translation, rotation), m, rad, along
    the object's own axes. Neighbouring rows err alike: what is unknown of the object's size is one error of all.
    """

    times_s: Floats  # (n,), increasing
    frame_ids: tuple[int, ...]
    world_from_object: tuple[Pose, ...]
    covariances: Floats  # (n, 6, 6)
    velocity_in_world: Floats  # (n, 3), m/s, of the object's origin
    speeds_m_s: Floats  # (n,), along the object's heading, negative backwards
    speed_sigmas_m_s: Floats  # (n,)
    turn_rates_rad_s: Floats  # (n,), about the object's z
    turn_rate_sigmas_rad_s: Floats  # (n,)

    def __post_init__(self) -> None:
        rows = {len(self.times_s), len(self.frame_ids), len(self.world_from_object), len(self.covariances)}
        rows |= {len(self.velocity_in_world), *(len(column) for column in self._driving)}
        if len(rows) != 1 or rows == {0}:
            raise MapError(f"a moving object's path has one row a pose, at least one, found {sorted(rows)}")
        if not (np.diff(self.times_s) > 0).all():
            raise MapError("a moving object's path has increasing times")

    def __len__(self) -> int:
        return len(self.times_s)

    @property
    def _driving(self) -> tuple[Floats, ...]:
        return self.speeds_m_s, self.speed_sigmas_m_s, self.turn_rates_rad_s, self.turn_rate_sigmas_rad_s

    @property
    def positions_in_world(self) -> Floats:
        """Centres (n, 3), metres."""
        return np.array([pose.translation for pose in self.world_from_object])

    @property
    def position_sigmas_m(self) -> Floats:
        """Standard deviation (n,) of each position: the root of the three axes' variances together."""
        roots: Floats = np.sqrt(np.trace(self.covariances[:, :3, :3], axis1=1, axis2=2))
        return roots

    @property
    def mean_speed_m_s(self) -> float:
        """Mean of the speeds' magnitudes."""
        return float(np.abs(self.speeds_m_s).mean())

    def at(self, time_s: float) -> Pose:
        """world_from_object at a time between two rows, as by a constant turn; MapError outside the path's times."""
        if not self.times_s[0] <= time_s <= self.times_s[-1]:
            span = f"{self.times_s[0]:.3f} to {self.times_s[-1]:.3f} s"
            raise MapError(f"the moving object's path is from {span}, asked for {time_s:.3f} s")
        i = int(np.clip(np.searchsorted(self.times_s, time_s), 1, max(1, len(self) - 1)))
        if len(self) == 1:
            return self.world_from_object[0]
        before, after = self.world_from_object[i - 1], self.world_from_object[i]
        share = float((time_s - self.times_s[i - 1]) / (self.times_s[i] - self.times_s[i - 1]))
        return before @ Pose.exp(share * (before.inverse() @ after).log())

    def of_origin(self, origin: Floats) -> MovingPath:
        """The path of another point (3,) of the object, with the same axes: covariances and velocities move along."""
        own_from_point = Pose(np.eye(3), origin)
        poses = tuple(pose @ own_from_point for pose in self.world_from_object)
        adjoint = own_from_point.inverse().adjoint()
        up = np.array([pose.rotation[:, 2] for pose in self.world_from_object])
        arms = np.array([pose.rotation @ origin for pose in self.world_from_object])
        swings = np.cross(self.turn_rates_rad_s[:, None] * up, arms)
        covariances = adjoint @ self.covariances @ adjoint.T
        velocity = self.velocity_in_world + swings
        return replace(self, world_from_object=poses, covariances=covariances, velocity_in_world=velocity)

    def to_csv(self) -> bytes:
        """Format as moving/<id>.csv (docs/formats.md); MapError if a number is not finite."""
        arrays = (self.covariances, self.velocity_in_world, *self._driving)
        if not all(np.isfinite(array).all() for array in arrays):
            raise MapError("a moving object's path to be saved holds NaN or infinity")
        lines = [",".join(COLUMNS)]
        for i, row in enumerate(self.to_tum().decode().splitlines()):
            time, *pose = row.split(" ")
            covariance = writable(self.covariances[i])
            values = [*self.velocity_in_world[i], *(column[i] for column in self._driving)]
            cells = [time, str(self.frame_ids[i]), *pose, *(f"{covariance[at] + 0.0:.6e}" for at in _UPPER)]
            lines.append(",".join([*cells, *(f"{np.round(value, 6) + 0.0:.6f}" for value in values)]))
        return ("\n".join(lines) + "\n").encode()

    def to_tum(self) -> bytes:
        """Format as `time tx ty tz qx qy qz qw` lines; MapError if a pose is not finite."""
        if not all(np.isfinite(pose.matrix).all() for pose in self.world_from_object):
            raise MapError("a moving object's path to be saved holds NaN or infinity")
        return format_tum(self.times_s, self.world_from_object).encode()

    @staticmethod
    def load(path: Path | str) -> MovingPath:
        """Read a moving/<id>.csv; columns that it does not know are left alone. MapError says what is wrong where."""
        path = Path(path)
        try:
            reader = csv.DictReader(io.StringIO(path.read_text(encoding="utf-8")))
        except (OSError, UnicodeDecodeError) as error:
            raise MapError(f"{path}: cannot be read: {error}") from None
        missing = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
        if missing:
            raise MapError(f"{path}: is no path of a moving object: its header lacks {', '.join(missing[:5])}")
        rows = [_numbers(f"{path}: line {line}", row) for line, row in enumerate(reader, 2)]
        values = np.array(rows).reshape(-1, len(COLUMNS))
        poses = tuple(_pose(f"{path}: line {line}", row) for line, row in enumerate(values, 2))
        covariances = np.zeros((len(values), 6, 6))
        for column, (i, j) in enumerate(_UPPER, len(_POSE)):
            covariances[:, i, j] = covariances[:, j, i] = values[:, column]
        frames = tuple(values[:, 1].astype(int).tolist())
        try:
            return MovingPath(values[:, 0], frames, poses, covariances, values[:, 30:33], *values[:, 33:].T)
        except MapError as error:
            raise MapError(f"{path}: {error}") from None


def _pose(where: str, values: Floats) -> Pose:
    try:
        return Pose.from_quaternion(values[5:9], values[2:5], order="xyzw")
    except GeometryError as error:
        raise MapError(f"{where}: {error}") from None


def _numbers(where: str, row: dict[str, str]) -> list[float]:
    found = []
    for name in COLUMNS:
        try:
            value = float(row[name])
        except (TypeError, ValueError):
            value = float("nan")
        if not np.isfinite(value):
            raise MapError(f"{where}: {name}: expected a finite number, found {row[name]!r:.40}")
        found.append(value)
    return found
