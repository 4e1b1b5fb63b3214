"""EuRoC's ground truth (state_groundtruth_estimate0/data.csv): nanoseconds, pose, velocity, biases."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from meshslam.exporting.finished_run import FinishedRun
from meshslam.exporting.formats import Notes
from meshslam.geometry import quaternions_of_rotations

HEADER = (
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], "
    "v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], "
    "b_w_RS_S_z [rad s^-1], b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], b_a_RS_S_z [m s^-2]"
)


def write(run: FinishedRun, target: Path) -> Notes:
    """The sensor S is the camera, the reference R the world; what the run does not know is 0."""
    poses, count = run.path.world_from_camera, len(run.path)
    rotations = np.array([pose.rotation for pose in poses]).reshape(-1, 3, 3)
    quaternions = quaternions_of_rotations(rotations)[:, [3, 0, 1, 2]] if count else np.zeros((0, 4))
    velocity, biases = np.zeros((count, 3)), np.zeros((count, 6))
    notes = ["euroc: poses are the camera's, not those of a body"]
    if run.estimate is not None:
        velocity = run.estimate.velocity_in_world
    else:
        notes.append("euroc: the run has no velocities: they are 0")
    if run.estimate is not None and run.estimate.biases is not None:
        biases = run.estimate.biases[:, [3, 4, 5, 0, 1, 2]]  # gyroscope, accelerometer
    rows = np.concatenate([run.path.positions_in_world, quaternions, velocity, biases], axis=1)
    lines = [HEADER]
    lines += [
        ",".join([str(time_ns), *(f"{value + 0.0:.9f}" for value in row)])
        for time_ns, row in zip(run.times_ns, rows, strict=True)
    ]
    target.write_text("\n".join(lines) + "\n", encoding="ascii")
    return tuple(notes)
