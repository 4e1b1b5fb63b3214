"""Settings of the live pipeline."""

from __future__ import annotations

from dataclasses import dataclass

from meshslam.settings import Settings, expert, public


@dataclass(frozen=True)
class LiveConfig(Settings):
    """SLAM at the camera's rate: what a frame may wait for, and what is done at once."""

    enabled: bool = expert(False)  # replay the recording by its clock through the live pipeline
    rate: float = expert(1.0, above=0)  # of that clock: 2 is twice as fast
    deadline_s: float = public(0.04, above=0, doc="a frame's pose comes so soon: by IMU, where the window takes longer")
    pending_frames: int = expert(2, low=1)  # that wait for the window or are in it; with more it is busy,
    busy_step_s: float = expert(0.18, low=0)  # and takes frames so far apart,
    max_pending_frames: int = expert(20, low=1)  # up to so many
    start_s: float = expert(2.8, above=0)  # of frames that a start is searched in; instead of a longer settling_s
    start_step_s: float = expert(0.18, low=0)  # between the frames that the start is found from
    imu_wait_s: float = expert(0.05, low=0)  # that a frame waits for its own samples
    zoom: float = expert(1.0, low=1)  # instead of segmentation.zoom: a second look takes as long as the first
    network_threads: int = expert(1, low=1)
    pending_poses: int = expert(100, low=1)  # that wait for `on_pose`; older ones are dropped
