"""Segmentation, tracking, and detections in and out."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.perception.adapter import adapter_beside
    from meshslam.perception.boxes import are_near, nearness_on_ground
    from meshslam.perception.class_names import our_names, renamed_set, renamings, untracked
    from meshslam.perception.colour import COLOUR, ColourConfig, ColourSegmenter
    from meshslam.perception.colour_code import body_colour_bgr, point_colour_bgr
    from meshslam.perception.conversion.class_numbers import read_class_names
    from meshslam.perception.conversion.coco import from_coco
    from meshslam.perception.conversion.coco_results import counted_from_one, from_coco_results
    from meshslam.perception.conversion.frames import ImageFrames
    from meshslam.perception.conversion.mots import from_mots_png, from_mots_txt
    from meshslam.perception.conversion.openpifpaf import with_openpifpaf
    from meshslam.perception.conversion.yolo_txt import from_yolo_txt
    from meshslam.perception.detections import CategoryEntry, Detection, DetectionSet, ImageEntry, write_detections
    from meshslam.perception.flow import corners, follow, grey
    from meshslam.perception.frame_perception import FramePerception
    from meshslam.perception.instances import Instance, Segmenter, SegmenterConfig
    from meshslam.perception.keypoints.crop import GREY, HEIGHT_PX, WIDTH_PX, Crop, cut_out, to_input
    from meshslam.perception.keypoints.decode import (
        ANGLES,
        CELL_PX,
        KEYPOINTS,
        REACH,
        angle_distribution,
        laplace_sigma,
        peak_angle,
        points_in_input,
    )
    from meshslam.perception.keypoints.finder import KeypointConfig, KeypointFinder, add_keypoints
    from meshslam.perception.keypoints.mirror import MIRRORED, Answers, answers_of
    from meshslam.perception.masks import decode_segmentation, encode_mask
    from meshslam.perception.model_store import ADVICE, add_model, find_model, store_folder, stored_models
    from meshslam.perception.reading import LEAST_ANGLES, check_detections, read_detections, read_recorded_detections
    from meshslam.perception.segmentation import detect, load_segmenter
    from meshslam.perception.tracking import TrackerConfig, track, voted_category
else:
    __getattr__ = deferred(
        __name__,
        {
            "adapter": "adapter_beside",
            "boxes": "are_near nearness_on_ground",
            "class_names": "our_names renamed_set renamings untracked",
            "colour": "COLOUR ColourConfig ColourSegmenter",
            "colour_code": "body_colour_bgr point_colour_bgr",
            "conversion.class_numbers": "read_class_names",
            "conversion.coco": "from_coco",
            "conversion.coco_results": "counted_from_one from_coco_results",
            "conversion.frames": "ImageFrames",
            "conversion.mots": "from_mots_png from_mots_txt",
            "conversion.openpifpaf": "with_openpifpaf",
            "conversion.yolo_txt": "from_yolo_txt",
            "detections": "CategoryEntry Detection DetectionSet ImageEntry write_detections",
            "flow": "corners follow grey",
            "frame_perception": "FramePerception",
            "instances": "Instance Segmenter SegmenterConfig",
            "keypoints.crop": "GREY HEIGHT_PX WIDTH_PX Crop cut_out to_input",
            "keypoints.decode": (
                "ANGLES CELL_PX KEYPOINTS REACH angle_distribution laplace_sigma peak_angle points_in_input"
            ),
            "keypoints.finder": "KeypointConfig KeypointFinder add_keypoints",
            "keypoints.mirror": "MIRRORED Answers answers_of",
            "masks": "decode_segmentation encode_mask",
            "model_store": "ADVICE add_model find_model store_folder stored_models",
            "reading": "LEAST_ANGLES check_detections read_detections read_recorded_detections",
            "segmentation": "detect load_segmenter",
            "tracking": "TrackerConfig track voted_category",
        },
    )

__all__ = [
    "ADVICE",
    "ANGLES",
    "CELL_PX",
    "COLOUR",
    "GREY",
    "HEIGHT_PX",
    "KEYPOINTS",
    "LEAST_ANGLES",
    "MIRRORED",
    "REACH",
    "WIDTH_PX",
    "Answers",
    "CategoryEntry",
    "ColourConfig",
    "ColourSegmenter",
    "Crop",
    "Detection",
    "DetectionSet",
    "FramePerception",
    "ImageEntry",
    "ImageFrames",
    "Instance",
    "KeypointConfig",
    "KeypointFinder",
    "Segmenter",
    "SegmenterConfig",
    "TrackerConfig",
    "adapter_beside",
    "add_keypoints",
    "add_model",
    "angle_distribution",
    "answers_of",
    "are_near",
    "body_colour_bgr",
    "check_detections",
    "corners",
    "counted_from_one",
    "cut_out",
    "decode_segmentation",
    "detect",
    "encode_mask",
    "find_model",
    "follow",
    "from_coco",
    "from_coco_results",
    "from_mots_png",
    "from_mots_txt",
    "from_yolo_txt",
    "grey",
    "laplace_sigma",
    "load_segmenter",
    "nearness_on_ground",
    "our_names",
    "peak_angle",
    "point_colour_bgr",
    "points_in_input",
    "read_class_names",
    "read_detections",
    "read_recorded_detections",
    "renamed_set",
    "renamings",
    "store_folder",
    "stored_models",
    "to_input",
    "track",
    "untracked",
    "voted_category",
    "with_openpifpaf",
    "write_detections",
]
