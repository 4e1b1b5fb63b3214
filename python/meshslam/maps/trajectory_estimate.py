"""A trajectory with its uncertainty, and its file `trajectory.csv`."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from meshslam.errors import GeometryError, MapError
from meshslam.files import write_atomically
from meshslam.geometry import Bools, Floats, Pose
from meshslam.maps.trajectory import Trajectory

_UPPER = [(i, j) for i in range(6) for j in range(i, 6)]
_POSE = ("timestamp", "frame", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
_COVARIANCE = tuple(f"c{i}{j}" for i, j in _UPPER)
_VELOCITY = ("vx", "vy", "vz")
_BIASES = ("bax", "bay", "baz", "bgx", "bgy", "bgz")
_LAST = ("source", "extrapolated", "position_sigma_m", "rotation_sigma_deg")
_NO_VARIANCE = 1e-18  # m^2, rad^2: of less than the last digit of a pose, which is rounding
_CORRELATION_DECIMALS = 7
_LEAST_SHARE = 2e-6  # least eigenvalue of a correlation matrix: what rounding and the digits written can move it by


@dataclass(frozen=True, eq=False)
class TrajectoryEstimate:
    """The camera's trajectory with the uncertainty of every pose; MapError if the numbers of rows differ.

    `covariances[i]` is that of xi in `world_from_camera[i].retract(xi)`: the camera is at t + R rho with the rotation
    R exp(phi), xi = (rho, phi), metres and radians along the camera's own axes (x right, y down, z ahead).

    Example:
        estimate = meshslam.slam("drive").estimate
        estimate.position_sigmas_m  # (n,)
        estimate.covariances_in_world[5]  # (6, 6) as ROS has it

    """

    trajectory: Trajectory
    frame_ids: tuple[int, ...]
    covariances: Floats  # (n, 6, 6), symmetric and positive semidefinite
    velocity_in_world: Floats  # (n, 3), m/s, of the camera
    biases: Floats | None  # (n, 6), accelerometer m/s^2, gyroscope rad/s; None without an IMU
    sources: tuple[str, ...]  # what a pose follows from beside its neighbours: images, imu or odometry
    extrapolated: Bools  # (n,), nothing that the frame's own image shows is in its pose

    def __post_init__(self) -> None:
        count = len(self.trajectory)
        rows = {len(self.frame_ids), len(self.covariances), len(self.velocity_in_world), len(self.sources)}
        rows |= {len(self.extrapolated), count if self.biases is None else len(self.biases)}
        if rows != {count}:
            raise MapError(f"a trajectory's estimate has one row a pose, found {sorted(rows | {count})}")

    def __len__(self) -> int:
        return len(self.trajectory)

    @property
    def position_sigmas_m(self) -> Floats:
        """Standard deviation (n,) of each position: the root of the three axes' variances together."""
        return _root_of_trace(self.covariances[:, :3, :3])

    @property
    def rotation_sigmas_rad(self) -> Floats:
        """Standard deviation (n,) of each rotation, likewise."""
        return _root_of_trace(self.covariances[:, 3:, 3:])

    @property
    def covariances_in_world(self) -> Floats:
        """Covariances (n, 6, 6) along the world's axes: of the position and of a rotation exp(theta) R from the left.

        diag(R, R) C diag(R, R)^T: x, y, z, then rotations about the world's x, y, z, as in ROS's PoseWithCovariance.
        """
        turns = np.zeros((len(self), 6, 6))
        for turn, pose in zip(turns, self.trajectory.world_from_camera, strict=True):
            turn[:3, :3] = turn[3:, 3:] = pose.rotation
        found: Floats = turns @ self.covariances @ turns.transpose(0, 2, 1)
        return found

    @property
    def figures(self) -> dict[str, float]:
        """Mean standard deviations, as metrics.json names them."""
        return {
            "position_sigma_mean_m": float(np.round(self.position_sigmas_m.mean(), 6)),
            "rotation_sigma_mean_deg": float(np.round(np.degrees(self.rotation_sigmas_rad).mean(), 6)),
        }

    def moved(self, world_from_given: Pose) -> TrajectoryEstimate:
        """The same in another world, which is exactly known: covariances and biases are along own axes, and stay."""
        poses = tuple(world_from_given @ pose for pose in self.trajectory.world_from_camera)
        velocity = self.velocity_in_world @ world_from_given.rotation.T
        return replace(self, trajectory=Trajectory(self.trajectory.times_s, poses), velocity_in_world=velocity)

    def to_csv(self) -> bytes:
        """Format as trajectory.csv (docs/trajectory.md); MapError if a number is not finite."""
        poses = self.trajectory.to_tum().decode().splitlines()
        numbers = [self.covariances, self.velocity_in_world] + ([] if self.biases is None else [self.biases])
        if not all(np.isfinite(array).all() for array in numbers):
            raise MapError("a trajectory's estimate to be saved holds NaN or infinity")
        biases = () if self.biases is None else _BIASES
        lines = [",".join((*_POSE, *_COVARIANCE, *_VELOCITY, *biases, *_LAST))]
        for i, row in enumerate(poses):
            time, *pose = row.split(" ")
            covariance = writable(self.covariances[i])
            sigmas = [np.sqrt(np.trace(block)) for block in (covariance[:3, :3], covariance[3:, 3:])]
            sigmas[1] = np.degrees(sigmas[1])
            cells = [time, str(self.frame_ids[i]), *pose]
            cells += [f"{covariance[at] + 0.0:.6e}" for at in _UPPER]
            states = [self.velocity_in_world[i]] + ([] if self.biases is None else [self.biases[i]])
            cells += [f"{value:.9f}" for value in np.round(np.concatenate(states), 9) + 0.0]
            cells += [self.sources[i], str(int(self.extrapolated[i])), *(f"{value:.6e}" for value in sigmas)]
            lines.append(",".join(cells))
        return ("\n".join(lines) + "\n").encode()

    def save(self, path: Path | str) -> None:
        """Write trajectory.csv, whole or not at all; MapError if a number is not finite, or the disk refuses."""
        write_atomically(Path(path), self.to_csv())

    @staticmethod
    def load(path: Path | str) -> TrajectoryEstimate:
        """Read a trajectory.csv; columns that it does not know are left alone. MapError with what is wrong where."""
        path = Path(path)
        try:
            reader = csv.DictReader(io.StringIO(path.read_text(encoding="utf-8")))
        except (OSError, UnicodeDecodeError) as error:
            raise MapError(f"{path}: cannot be read: {error}") from None
        header = reader.fieldnames or ()
        needed = (*_POSE, *_COVARIANCE, *_VELOCITY)
        missing = [name for name in (*needed, "source") if name not in header]
        if missing:
            raise MapError(f"{path}: is no trajectory with uncertainty: its header lacks {', '.join(missing[:5])}")
        names = (*needed, *_BIASES) if set(_BIASES) <= set(header) else needed
        rows = list(reader)
        found = [_numbers(f"{path}: line {line}", row, names) for line, row in enumerate(rows, 2)]
        values = np.array(found).reshape(-1, len(names))
        poses = tuple(_pose(f"{path}: line {line}", row) for line, row in enumerate(values, 2))
        covariances = np.zeros((len(values), 6, 6))
        for column, (i, j) in enumerate(_UPPER, len(_POSE)):
            covariances[:, i, j] = covariances[:, j, i] = values[:, column]
        return TrajectoryEstimate(
            Trajectory(values[:, 0], poses),
            tuple(values[:, 1].astype(int).tolist()),
            covariances,
            values[:, 30:33],
            values[:, 33:] if len(names) > len(needed) else None,
            tuple(row["source"] for row in rows),
            np.array([row.get("extrapolated") == "1" for row in rows], bool),
        )


def writable(covariance: Floats) -> Floats:
    """The covariance (6, 6) as it is written: its digits are positive semidefinite, and none of them is rounding's.

    Correlations are rounded; where their matrix then has an eigenvalue below what rounding moves, it is raised to that.
    A variance of nothing (a pose that the others are relative to) is 0.
    """
    sigmas = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    sigmas[sigmas**2 < _NO_VARIANCE] = 0.0
    scale = np.outer(sigmas, sigmas)
    unit = np.divide(covariance + covariance.T, 2.0 * scale, out=np.eye(6), where=scale > 0)
    values, vectors = np.linalg.eigh(unit)
    if values[0] < _LEAST_SHARE:
        unit = (vectors * np.maximum(values, _LEAST_SHARE)) @ vectors.T
    rounded: Floats = np.round(unit, _CORRELATION_DECIMALS) * scale
    return rounded


def _root_of_trace(blocks: Floats) -> Floats:
    roots: Floats = np.sqrt(np.maximum(np.trace(blocks, axis1=1, axis2=2), 0.0))
    return roots


def _pose(where: str, values: Floats) -> Pose:
    try:
        return Pose.from_quaternion(values[5:9], values[2:5], order="xyzw")
    except GeometryError as error:
        raise MapError(f"{where}: {error}") from None


def _numbers(where: str, row: dict[str, str], names: tuple[str, ...]) -> Floats:
    try:
        found = np.array([float(row[name]) for name in names])
    except (TypeError, ValueError):
        found = np.full(len(names), np.nan)
    if not np.isfinite(found).all():
        bad = next(name for name in names if not _is_number(row[name]))
        raise MapError(f"{where}: {bad}: expected a finite number, found {row[bad]!r:.40}")
    return found


def _is_number(text: str | None) -> bool:
    try:
        return text is not None and bool(np.isfinite(float(text)))
    except ValueError:
        return False
