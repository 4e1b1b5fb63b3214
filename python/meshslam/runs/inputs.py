"""What a run reads, by its content: a changed input is another run."""

from __future__ import annotations

import contextlib
from pathlib import Path

from meshslam.categories import load_category
from meshslam.errors import ModelError
from meshslam.files import digest_of, digest_of_file
from meshslam.maps import Map, TiledMap
from meshslam.perception import adapter_beside, find_model
from meshslam.runs.commands import uses
from meshslam.runs.config import Config
from meshslam.sequences import Sequence


def input_digests(command: str, recording: Sequence, settings: Config) -> dict[str, str]:
    """Digests of everything that an estimate is made from, by what it is called; OSError if a file cannot be read."""
    given, chosen = recording.detections_path, settings.input
    found = recording_digests(recording)
    if uses(command, "input.category"):
        found["category"] = digest_of(load_category(chosen.category))
    if recording.images is not None:
        found["images"] = digest_of(image_digests(recording))
        found |= network_digests(recording, settings)
    if given is not None and chosen.segmenter is None and given.is_file():
        found["detections"] = digest_of_file(given)
    if uses(command, "input.map") and chosen.map is not None:
        scene = Map.open(Path(chosen.map), allow_outside=chosen.allow_outside)
        found["map"] = scene.digest if isinstance(scene, TiledMap) else digest_of(scene.objects)
    return found


def recording_digests(recording: Sequence) -> dict[str, str]:
    """Digests of a recording's parts beside images and detections."""
    camera = (recording.camera, recording.distortion, recording.height_above_ground_m, recording.is_levelled)
    parts = {
        "camera calibration": camera,
        "frames' times": (recording.frame_ids, recording.times_s),
        "camera poses": recording.world_from_camera,
        "IMU samples": recording.imu,
        "IMU mounting": recording.imu_from_camera,
        "initial state": recording.initial_state,
    }
    return {name: digest_of(part) for name, part in parts.items() if part is not None}


def image_digests(recording: Sequence) -> tuple[str, ...]:
    """A text for each image that is another for other content."""
    return () if recording.images is None else recording.images.digests()


def network_digests(recording: Sequence, settings: Config) -> dict[str, str]:
    """Digests of the networks that look at the images; one that is missing is told when it is loaded."""
    found, model = {}, settings.keypoints.model
    if settings.keypoints.enabled and model is not None:
        found["key point network"] = Path(model)
    if settings.input.segmenter is not None or recording.detections_path is None:
        with contextlib.suppress(ModelError):
            network, adapter = find_model(settings.input.segmenter), settings.input.adapter
            found["segmentation network"] = network
            found["adapter"] = adapter_beside(network) if adapter is None else Path(adapter)
    return {name: digest_of_file(path) for name, path in found.items() if path.is_file()}
