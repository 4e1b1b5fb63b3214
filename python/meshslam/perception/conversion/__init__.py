"""Detections of other tools, brought to the contract of FORMATS.md's detections.json."""

from meshslam.perception.conversion.coco_results import from_coco_results
from meshslam.perception.conversion.frames import ImageFrames
from meshslam.perception.conversion.mots import from_mots_png, from_mots_txt
from meshslam.perception.conversion.openpifpaf import with_openpifpaf
from meshslam.perception.conversion.yolo_txt import from_yolo_txt

__all__ = ["ImageFrames", "from_coco_results", "from_mots_png", "from_mots_txt", "from_yolo_txt", "with_openpifpaf"]
