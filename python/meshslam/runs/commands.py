"""Which command uses which settings: a test notes what runs read, so that this table stays true."""

from __future__ import annotations

RECORDING = (
    "input.sequence",
    "input.layout",
    "input.camera",
    "input.camera_file",
    "input.size",
    "input.rate_hz",
    "input.times",
    "input.scene",
    "input.topics",
    "input.frames",
    "input.from_s",
    "input.to_s",
    "input.imu",
    "input.imu_from_camera",
    "input.imu_time_offset_s",
    "input.poses",
    "input.poses_convention",
    "input.camera_from_body",
    "input.poses_time_offset_s",
    "input.poses_scale",
)
_PERCEPTION = ("input.segmenter", "input.adapter", "input.category_names", "segmentation", "colour", "keypoints")
_SEEN = (*RECORDING, "input.detections", *_PERCEPTION)
_OBJECTS = ("input.category", "tracking", "objects", "mapping")

USED: dict[str, tuple[str, ...]] = {  # settings, or groups of them
    "detect": (*RECORDING, *_PERCEPTION, "tracking.categories"),
    "map": (*_SEEN, *_OBJECTS, "lengths", "rotations"),
    "localize": (*_SEEN, "input.map", "input.allow_outside", "estimation", "localization"),
    "slam": (*_SEEN, *_OBJECTS, "estimation", "slam", "live"),
    "merge": ("input.allow_outside", "objects", "merging"),
    "reproduce views": ("objects",),
    "reproduce localization": ("estimation", "localization"),
}
# what a command has a setting of its own for
INSTEAD: dict[str, dict[str, str]] = {
    "map": {"slam.solver": "objects.solver"},
    "localize": {"slam.solver": "localization.solver", "slam.lag_s": "estimation.smoother.lag_s"},
    "slam": {
        "localization.solver": "slam.solver",
        "estimation.smoother.lag_s": "slam.lag_s",
        "estimation.imu.gyroscope_noise": "slam.gyroscope_noise",
        "estimation.imu.time_offset_sigma_s": "slam.time_offset_sigma_s",
        "estimation.imu.extrinsic_rotation_sigma_deg": "slam.extrinsic_rotation_sigma_deg",
    },
}


def uses(command: str, path: str) -> bool:
    """Whether a command uses a setting, such as `slam.points.corners`."""
    if path in INSTEAD.get(command, {}):
        return False
    return any(path == used or path.startswith(f"{used}.") for used in USED[command])


def users(path: str) -> tuple[str, ...]:
    """The commands that use a setting, less those that reproduce the paper."""
    return tuple(command for command in ("map", "localize", "slam", "merge", "detect") if uses(command, path))


def why_unused(command: str, path: str) -> str:
    """What to tell a user who gave a command a setting that it does not use."""
    own = INSTEAD.get(command, {}).get(path)
    if own is not None:
        return f"{command} does not use {path} but {own}: give that one"
    return f"{command} does not use {path} ({' and '.join(users(path))} {_do(users(path))}): remove it"


def _do(names: tuple[str, ...]) -> str:
    return "does" if len(names) == 1 else "do"
