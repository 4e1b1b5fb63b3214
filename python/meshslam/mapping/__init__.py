"""All objects of a drive; what moves or does not fit is left out, with the reason."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.mapping.config import MappingConfig
    from meshslam.mapping.left_out import LeftOut
    from meshslam.mapping.one_object import object_from_masks
    from meshslam.mapping.pipeline import ObjectMapping, Stages, map_objects
    from meshslam.mapping.sizes import size_of_cars
    from meshslam.mapping.work import Progress
else:
    __getattr__ = deferred(
        __name__,
        {
            "config": "MappingConfig",
            "left_out": "LeftOut",
            "one_object": "object_from_masks",
            "pipeline": "ObjectMapping Stages map_objects",
            "sizes": "size_of_cars",
            "work": "Progress",
        },
    )

__all__ = [
    "LeftOut",
    "MappingConfig",
    "ObjectMapping",
    "Progress",
    "Stages",
    "map_objects",
    "object_from_masks",
    "size_of_cars",
]
