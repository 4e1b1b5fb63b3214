"""Segmentation, tracking, and detections in and out."""

from meshslam.perception.colour import ColourConfig, ColourSegmenter
from meshslam.perception.detections import CategoryEntry, Detection, DetectionSet, ImageEntry, write_detections
from meshslam.perception.instances import Instance, Segmenter, SegmenterConfig
from meshslam.perception.keypoints.finder import KeypointConfig, KeypointFinder, add_keypoints
from meshslam.perception.masks import encode_mask
from meshslam.perception.reading import read_detections
from meshslam.perception.segmentation import detect, load_segmenter
from meshslam.perception.tracking import TrackerConfig, track, voted_category

__all__ = [
    "CategoryEntry",
    "ColourConfig",
    "ColourSegmenter",
    "Detection",
    "DetectionSet",
    "ImageEntry",
    "Instance",
    "KeypointConfig",
    "KeypointFinder",
    "Segmenter",
    "SegmenterConfig",
    "TrackerConfig",
    "add_keypoints",
    "detect",
    "encode_mask",
    "load_segmenter",
    "read_detections",
    "track",
    "voted_category",
    "write_detections",
]
