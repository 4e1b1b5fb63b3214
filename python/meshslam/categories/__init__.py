"""Categories of objects: template mesh, key points and shape space; the procedural families; the builder."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.categories.build import build_family, category_of, wrapped_cars
    from meshslam.categories.category import Category, category_bytes, category_names, load_category, save_category
    from meshslam.categories.from_meshes import MeshOptions, category_from_meshes
    from meshslam.categories.keypoints import KEYPOINT_NAMES, keypoint_order
    from meshslam.categories.procedural.car import CarShape
    from meshslam.categories.procedural.heavy import draw_bus, draw_truck
    from meshslam.categories.procedural.solid import distance_and_normal, project
    from meshslam.categories.procedural.styles import CLASSES, CarClass, draw_car, draw_of_class
    from meshslam.categories.procedural.vans import VANS, Van, draw_of_van, draw_van
    from meshslam.categories.shrinkwrap import Wrapper, carry
    from meshslam.categories.spheres import icosphere, subdivide
    from meshslam.categories.template import car_template, middle_car
else:
    __getattr__ = deferred(
        __name__,
        {
            "build": "build_family category_of wrapped_cars",
            "category": "Category category_bytes category_names load_category save_category",
            "from_meshes": "MeshOptions category_from_meshes",
            "keypoints": "KEYPOINT_NAMES keypoint_order",
            "procedural.car": "CarShape",
            "procedural.heavy": "draw_bus draw_truck",
            "procedural.solid": "distance_and_normal project",
            "procedural.styles": "CLASSES CarClass draw_car draw_of_class",
            "procedural.vans": "VANS Van draw_of_van draw_van",
            "shrinkwrap": "Wrapper carry",
            "spheres": "icosphere subdivide",
            "template": "car_template middle_car",
        },
    )

__all__ = [
    "CLASSES",
    "KEYPOINT_NAMES",
    "VANS",
    "CarClass",
    "CarShape",
    "Category",
    "MeshOptions",
    "Van",
    "Wrapper",
    "build_family",
    "car_template",
    "carry",
    "category_bytes",
    "category_from_meshes",
    "category_names",
    "category_of",
    "distance_and_normal",
    "draw_bus",
    "draw_car",
    "draw_of_class",
    "draw_of_van",
    "draw_truck",
    "draw_van",
    "icosphere",
    "keypoint_order",
    "load_category",
    "middle_car",
    "project",
    "save_category",
    "subdivide",
    "wrapped_cars",
]
