"""The camera in a known map of meshes."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.localization.archive import archive_errors, read_archive, under, write_archive
    from meshslam.localization.arrivals import checked_samples
    from meshslam.localization.config import AssociationConfig, GateConfig, LocalizationConfig, RelocalizationConfig
    from meshslam.localization.data_association import FrameMasks
    from meshslam.localization.estimator import FrameReport, LocalizationEstimator
    from meshslam.localization.gradient_estimator import CameraLoss, camera_loss, descend, descend_camera, per_pixel
    from meshslam.localization.local_mapping import LocalMap, MakeLocalMapping
    from meshslam.localization.localizer import Localizer, LocalizerSettings
    from meshslam.localization.map_models import KnownMap, KnownObject, known_objects
    from meshslam.localization.sequence import Localization, LocalizedFrame, localize_sequence
    from meshslam.localization.stream import Stream
else:
    __getattr__ = deferred(
        __name__,
        {
            "archive": "archive_errors read_archive under write_archive",
            "arrivals": "checked_samples",
            "config": "AssociationConfig GateConfig LocalizationConfig RelocalizationConfig",
            "data_association": "FrameMasks",
            "estimator": "FrameReport LocalizationEstimator",
            "gradient_estimator": "CameraLoss camera_loss descend descend_camera per_pixel",
            "local_mapping": "LocalMap MakeLocalMapping",
            "localizer": "Localizer LocalizerSettings",
            "map_models": "KnownMap KnownObject known_objects",
            "sequence": "Localization LocalizedFrame localize_sequence",
            "stream": "Stream",
        },
    )

__all__ = [
    "AssociationConfig",
    "CameraLoss",
    "FrameMasks",
    "FrameReport",
    "GateConfig",
    "KnownMap",
    "KnownObject",
    "LocalMap",
    "Localization",
    "LocalizationConfig",
    "LocalizationEstimator",
    "LocalizedFrame",
    "Localizer",
    "LocalizerSettings",
    "MakeLocalMapping",
    "RelocalizationConfig",
    "Stream",
    "archive_errors",
    "camera_loss",
    "checked_samples",
    "descend",
    "descend_camera",
    "known_objects",
    "localize_sequence",
    "per_pixel",
    "read_archive",
    "under",
    "write_archive",
]
