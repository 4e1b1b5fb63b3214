"""The marginal of a smoother's newest state: what a saved run goes on from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X

from meshslam.errors import MapError
from meshslam.geometry import Floats, Pose
from meshslam.graph.smoother import Smoother
from meshslam.graph.start_factors import OFFSET, ROTATION
from meshslam.motion import Mounting, NavState


@dataclass(frozen=True, eq=False)
class StateMarginal:
    """The newest state and the mounting with their joint information, as rows |A x - b|.

    x: E (3), T (1), V (3), X (6: rotation, translation), B (6: accelerometer, gyroscope), steps from the values held.
    """

    state: NavState
    rate_rad_s: Floats  # (3,), free of bias
    mounting: Mounting
    rows: Floats  # (n, 20), [A b]

    def arrays(self) -> dict[str, Floats]:
        """Plain arrays by name."""
        s = self.state
        return {
            "time_s": np.array(s.time_s),
            "world_from_imu": s.world_from_imu.matrix,
            "velocity": s.velocity_in_world,
            "biases": np.concatenate([s.accelerometer_bias, s.gyroscope_bias]),
            "rate": self.rate_rad_s,
            "imu_from_camera": self.mounting.imu_from_camera.matrix,
            "time_offset_s": np.array(self.mounting.time_offset_s),
            "rows": self.rows,
        }

    @staticmethod
    def from_arrays(arrays: Mapping[str, Floats]) -> StateMarginal:
        """The reverse of `arrays`; MapError names what is missing."""
        try:
            biases = arrays["biases"]
            pose, mounted = Pose.from_matrix(arrays["world_from_imu"]), Pose.from_matrix(arrays["imu_from_camera"])
            state = NavState(float(arrays["time_s"]), pose, arrays["velocity"], biases[:3], biases[3:])
            mounting = Mounting(mounted, float(arrays["time_offset_s"]))
            return StateMarginal(state, arrays["rate"], mounting, arrays["rows"])
        except KeyError as error:
            raise MapError(f"a saved system lacks {error}") from None


def marginal_of(smoother: Smoother) -> StateMarginal:
    """Marginalize all but the newest state and the mounting; the smoother ends with this."""
    newest, window, cameras = smoother.frame, smoother.window, smoother.cameras
    keep = [ROTATION, OFFSET, V(newest), X(newest), B(newest)]
    window.marginalize(set(window.values.keys()) - set(keep))
    ordering = gtsam.Ordering()
    for key in keep:
        ordering.push_back(key)
    rows = np.asarray(window.linearized().augmentedJacobian(ordering))
    estimate = cameras.estimate(newest)
    cameras.drop([f for f in cameras.held if f != newest])
    smoother.objects.clear()
    return StateMarginal(estimate.state, cameras.rates_rad_s[newest], cameras.mounting(), rows)


def begin_with(smoother: Smoother, marginal: StateMarginal) -> None:
    """Begin a fresh smoother with a marginal as the only prior."""
    smoother.cameras.insert_mounting(marginal.mounting)
    smoother.cameras.insert(0, marginal.state, marginal.rate_rad_s + marginal.state.gyroscope_bias)
    keys = [(ROTATION, 3), (OFFSET, 1), (V(0), 3), (X(0), 6), (B(0), 6)]
    smoother.window.add_rows(keys, marginal.rows)
