"""Detections of other tools, brought to the contract of docs/formats.md: detections.json."""

from meshslam.perception.conversion.class_numbers import read_class_names
from meshslam.perception.conversion.coco import from_coco
from meshslam.perception.conversion.coco_results import counted_from_one, from_coco_results
from meshslam.perception.conversion.frames import ImageFrames
from meshslam.perception.conversion.mots import from_mots_png, from_mots_txt
from meshslam.perception.conversion.openpifpaf import with_openpifpaf
from meshslam.perception.conversion.yolo_txt import from_yolo_txt

__all__ = [
    "ImageFrames",
    "counted_from_one",
    "from_coco",
    "from_coco_results",
    "from_mots_png",
    "from_mots_txt",
    "from_yolo_txt",
    "read_class_names",
    "with_openpifpaf",
]
