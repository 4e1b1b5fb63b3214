"""Where motion starts when nobody says: gravity, velocity and scale from IMU samples and the boxes of tracked objects.

Rotations come from the gyroscope. In the first IMU's frame the camera of frame k stands at v t + g t^2 / 2 + s_k, where
s_k is the specific force integrated twice; an object's box gives the direction to its centre, and its height the depth
up to the object's own size. All of this is linear in v, g, the objects' places and their sizes (compare Qin and Shen
2018).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Camera, Floats, geman_mcclure_soft
from meshslam.settings import Settings, expert

_KERNELS = np.array([8.0, 4.0, 2.0, 1.4, 1.0, 1.0, 1.0, 1.0])  # graduated: all objects count at first


@dataclass(frozen=True)
class AlignmentConfig(Settings):
    """How well the rough start is told by each of its sources."""

    seconds: float = expert(2.0, above=0, unit="s")  # that are looked at
    size_sigma: float = expert(0.12, above=0)  # of an object's height, as a share
    nearer_m: float = expert(1.5, low=0)  # a box's height is that of parts that are so much nearer than the centre
    depth_sigma: float = expert(0.07, above=0)  # of one box's height against its object's others, as a share
    centre_sigma_m: float = expert(0.3, above=0)  # of a box's middle against the object's
    road_sigma_m: float = expert(0.15, above=0)
    road_slope_sigma: float = expert(0.03, low=0)  # more for every metre away from the camera
    tilt_sigma_rad: float = expert(0.3, above=0)  # of the mean specific force against gravity: a third of g in a bend
    slip_sigma_m_s: float = expert(0.4, above=0)  # of the velocity across the axis of a camera that rides on a road
    camera_tilt_sigma_rad: float = expert(0.05, above=0)  # of such a camera's axes against the horizon
    acceleration_sigma_m_s2: float = expert(0.8, above=0)  # along its axis, over all of the time
    speed_sigma_m_s: float = expert(20.0, above=0)
    kernel: float = expert(2.0, above=0)  # Geman and McClure's threshold, in sigmas: some of the objects drive


@dataclass(frozen=True, eq=False)
class CameraMotion:
    """A camera before gravity and velocity are known, in the first IMU's frame: centre = W v + g t^2 / 2 + offset.

    By an IMU W is t I, and the IMU's velocity there is v + g t + gain. By images alone it is W v = v_x w, w being the
    displacement in units of the speed, and gravity does not act.
    """

    time_s: float  # since the first
    rotation: Floats  # (3, 3), first imu from camera
    offset_m: Floats  # (3,)
    gain_m_s: Floats | None  # (3,); None by images alone
    displacement_s: Floats | None = None  # (3,), by images alone

    def by_velocity(self) -> Floats:
        """W (3, 3)."""
        return (
            self.time_s * np.eye(3) if self.displacement_s is None else np.outer(self.displacement_s, [1.0, 0.0, 0.0])
        )

    def by_gravity(self) -> float:
        """How far gravity of one m/s2 takes it."""
        return 0.5 * self.time_s**2 if self.displacement_s is None else 0.0


@dataclass(frozen=True)
class BoxObservation:
    """The box of a tracked object that is not cut by the image's edge."""

    track: int
    frame: int  # index
    middle_px: tuple[float, float]
    height_px: float
    height_m: float  # of its category


@dataclass(frozen=True, eq=False)
class Alignment:
    """What the first seconds say, in the first IMU's frame."""

    gravity_m_s2: Floats  # (3,), downwards
    velocity_m_s: Floats  # (3,), of the IMU
    places_m: dict[int, Floats]  # of each track's object
    sizes: dict[int, float]  # of each, as a share of its category's


def align(
    motions: Sequence[CameraMotion],
    observations: Sequence[BoxObservation],
    camera: Camera,
    mean_force_m_s2: Floats,
    gravity_m_s2: float,
    height_above_ground_m: float | None,
    config: AlignmentConfig,
) -> Alignment:
    """Solve for gravity, velocity, places and sizes by least squares, robust against objects that move.

    `mean_force_m_s2` (3,) is the specific force in the first IMU's frame: gravity but for the acceleration.
    """
    tracks = sorted({s.track for s in observations})
    down = -mean_force_m_s2 / np.linalg.norm(mean_force_m_s2)
    prior, speed = gravity_m_s2 * down, 1.0 / config.speed_sigma_m_s
    size = 6 + 4 * len(tracks)
    x = np.zeros(size)
    x[3:6] = prior
    weights = np.ones(len(observations))
    for kernel in config.kernel * _KERNELS:
        rows = _Rows(size)
        rows.add({0: speed * np.eye(3)}, np.zeros(3))
        rows.add(
            {3: np.eye(3) / (gravity_m_s2 * config.tilt_sigma_rad)}, prior / (gravity_m_s2 * config.tilt_sigma_rad)
        )
        rows.add({3: 100.0 * down[None]}, np.array([100.0 * gravity_m_s2]))  # its length is known
        if height_above_ground_m is not None:
            for columns, right in _road_vehicle_rows(motions, gravity_m_s2, config):
                rows.add(columns, right)
        for i in range(len(tracks)):
            rows.add({9 + 4 * i: np.eye(1) / config.size_sigma}, np.ones(1) / config.size_sigma)
        blocks = [
            _observation_rows(s, motions[s.frame], tracks.index(s.track), camera, down, height_above_ground_m, config)
            for s in observations
        ]
        for weight, (columns, right) in zip(weights, blocks, strict=True):
            root = float(np.sqrt(weight))
            rows.add({at: root * block for at, block in columns.items()}, root * right)
        x = rows.solve()
        weights = np.array([_robust(columns, right, x, float(kernel)) for columns, right in blocks])
        down = x[3:6] / np.linalg.norm(x[3:6])
    places = {t: x[6 + 4 * i : 9 + 4 * i] for i, t in enumerate(tracks)}
    sizes = {t: float(x[9 + 4 * i]) for i, t in enumerate(tracks)}
    return Alignment(gravity_m_s2 * down, x[:3], places, sizes)


def levelled(down: Floats, forward: Floats) -> Floats:
    """Rotation (3, 3) to a world with z up and x along `forward`, both (3,) in the frame that it turns."""
    up = -down / np.linalg.norm(down)
    ahead = forward - up * (up @ forward)
    ahead /= np.linalg.norm(ahead)
    return np.stack([ahead, np.cross(up, ahead), up])


class _Rows:
    def __init__(self, size: int) -> None:
        self._size, self._left, self._right = size, [np.zeros((0, size))], [np.zeros(0)]

    def add(self, columns: dict[int, Floats], right: Floats) -> None:
        block = np.zeros((len(right), self._size))
        for at, values in columns.items():
            block[:, at : at + values.shape[1]] += values
        self._left.append(block)
        self._right.append(right)

    def solve(self) -> Floats:
        found: Floats = np.linalg.lstsq(np.concatenate(self._left), np.concatenate(self._right), rcond=None)[0]
        return found


def _observation_rows(
    observation: BoxObservation,
    motion: CameraMotion,
    number: int,
    camera: Camera,
    down: Floats,
    height_above_ground_m: float | None,
    config: AlignmentConfig,
) -> tuple[dict[int, Floats], Floats]:
    """Whitened rows of one box: two across its line of sight, one along, one for the road."""
    at = 6 + 4 * number
    depth_m = camera.fy * observation.height_m / observation.height_px  # of an object of the mean size
    ray = camera.rays(np.array(observation.middle_px))
    to_camera = motion.rotation.T
    across = np.array([[1.0, 0.0, -ray[0]], [0.0, 1.0, -ray[1]]]) @ to_camera / config.centre_sigma_m
    along = to_camera[2:] / (config.depth_sigma * depth_m)
    place = np.concatenate([across, along])
    sized = np.array([[0.0], [0.0], [-1.0 / config.depth_sigma]])
    if height_above_ground_m is not None:
        road = down[None] / float(np.hypot(config.road_sigma_m, config.road_slope_sigma * depth_m))
        place = np.concatenate([place, road])
        share = float(np.linalg.norm(road))
        sized = np.concatenate([sized, [[0.5 * observation.height_m * share]]])
    right = place @ motion.offset_m
    right[2] += config.nearer_m / (config.depth_sigma * depth_m)
    if height_above_ground_m is not None:
        right[3] += height_above_ground_m * share
    return {0: -place @ motion.by_velocity(), 3: -motion.by_gravity() * place, at: place, at + 3: sized}, right


def _road_vehicle_rows(
    motions: Sequence[CameraMotion], gravity_m_s2: float, config: AlignmentConfig
) -> list[tuple[dict[int, Floats], Floats]]:
    """A car moves along its camera's axis, neither aside nor up, at an even speed, on a road that is hardly steep."""
    slip, out = config.slip_sigma_m_s * float(np.sqrt(len(motions))), []
    for motion in motions:
        if motion.gain_m_s is None:
            continue
        across = motion.rotation.T[:2] / slip
        out.append(({0: across, 3: motion.time_s * across}, -across @ motion.gain_m_s))
    first, last = motions[0], motions[-1]
    faster = config.acceleration_sigma_m_s2 * max(last.time_s, 1e-3)
    ahead, before = last.rotation.T[2:] / faster, first.rotation.T[2:] / faster
    if last.gain_m_s is not None:
        out.append(({0: ahead - before, 3: last.time_s * ahead}, -ahead @ last.gain_m_s))
    level = first.rotation.T[[0, 2]] / (gravity_m_s2 * config.camera_tilt_sigma_rad)
    out.append(({3: level}, np.zeros(2)))
    return out


def _robust(columns: dict[int, Floats], right: Floats, x: Floats, kernel: float) -> float:
    """Geman and McClure's weight of a box observation at a solution."""
    residual = sum((block @ x[at : at + block.shape[1]] for at, block in columns.items()), -right)
    return float(geman_mcclure_soft(float(residual @ residual), kernel**2) ** -2)
