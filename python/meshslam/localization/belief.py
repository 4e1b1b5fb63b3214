"""What a smoother believes of its newest state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from meshslam.errors import MapError
from meshslam.geometry import Pose
from meshslam.geometry.arrays import Floats
from meshslam.localization.imu import Mounting, NavState


@dataclass(frozen=True, eq=False)
class SmootherBelief:
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
    def from_arrays(arrays: Mapping[str, Floats]) -> SmootherBelief:
        """The reverse of `arrays`; MapError names what is missing."""
        try:
            biases = arrays["biases"]
            pose, mounted = Pose.from_matrix(arrays["world_from_imu"]), Pose.from_matrix(arrays["imu_from_camera"])
            state = NavState(float(arrays["time_s"]), pose, arrays["velocity"], biases[:3], biases[3:])
            mounting = Mounting(mounted, float(arrays["time_offset_s"]))
            return SmootherBelief(state, arrays["rate"], mounting, arrays["rows"])
        except KeyError as error:
            raise MapError(f"a saved system lacks {error}") from None
