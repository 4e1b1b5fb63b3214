"""KITTI odometry's segment errors, loop by loop as the devkit's text describes them: with 4x4 matrices only."""

import math
from itertools import pairwise

import numpy as np


def slow_segment_errors(true_poses, estimated_poses, lengths_m=(100, 200, 300, 400, 500, 600, 700, 800), step=10):
    """(first frame, rotation error rad/m, translation error m/m, length) of every segment."""
    distance = [0.0]
    for before, after in pairwise(true_poses):
        dx, dy, dz = after[:3, 3] - before[:3, 3]
        distance.append(distance[-1] + math.sqrt(dx * dx + dy * dy + dz * dz))
    rows = []
    for first in range(0, len(true_poses), step):
        for length in lengths_m:
            last = next((i for i in range(first, len(distance)) if distance[i] > distance[first] + length), None)
            if last is None:
                continue
            true_motion = np.linalg.inv(true_poses[first]) @ true_poses[last]
            found_motion = np.linalg.inv(estimated_poses[first]) @ estimated_poses[last]
            error = np.linalg.inv(found_motion) @ true_motion
            cosine = 0.5 * (error[0, 0] + error[1, 1] + error[2, 2] - 1)
            turn = math.acos(max(min(cosine, 1.0), -1.0))
            rows.append((first, turn / length, float(np.linalg.norm(error[:3, 3])) / length, length))
    return rows
