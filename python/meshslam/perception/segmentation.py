"""Instance segmentation by ONNX Runtime: images in, detections out."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from meshslam.geometry import Bytes
from meshslam.perception.adapter import Adapter, adapter_beside, read_adapter
from meshslam.perception.coco import VEHICLES
from meshslam.perception.detections import CategoryEntry, Detection, DetectionSet, ImageEntry
from meshslam.perception.instances import Instance, Segmenter, SegmenterConfig
from meshslam.perception.mask_rcnn import MaskRcnnSegmenter, has_open_size, recognize_mask_rcnn
from meshslam.perception.masks import encode_mask
from meshslam.perception.network_segmenter import NetworkSegmenter
from meshslam.perception.network_session import image_session, open_network


def load_segmenter(
    path: Path,
    config: SegmenterConfig | None = None,
    threads: int = 2,
    adapter: Path | None = None,
    renamed: Mapping[str, str] | None = None,
    tracked: Collection[str] = VEHICLES,
) -> NetworkSegmenter | MaskRcnnSegmenter:
    """Load a network for instance segmentation; its kind is told from its outputs and metadata.

    Known are YOLO-seg (v5, v8, 9, 11, 12, 26, YOLOE; with suppression inside or without), RF-DETR-seg and Mask R-CNN
    (torchvision, ONNX model zoo). An `adapter` says how any other is fed and read; `net.adapter.yaml` beside `net.onnx`
    is one. `renamed` are our names of classes by the network's, in small letters; None: all keep their names. What is
    assumed is in the result's `notes`.

    Raises ModelError if the file cannot be loaded or its inputs, outputs or class names fit nothing known.
    """
    path = Path(path)
    session = open_network(path, threads)
    said = read_adapter(adapter) if adapter is not None else _beside(path)
    layout = recognize_mask_rcnn(session)
    if layout is not None and said is None and has_open_size(session):
        return MaskRcnnSegmenter(path, session, layout, config or SegmenterConfig(), renamed, tracked)
    return NetworkSegmenter(image_session(path, session), config or SegmenterConfig(), said, renamed, tracked)


def _beside(path: Path) -> Adapter | None:
    found = adapter_beside(path)
    return read_adapter(found) if found.is_file() else None


def detect(
    frames: Iterable[tuple[int, Bytes]],
    segmenter: Segmenter,
    progress: Callable[[int], None] | None = None,
    file_name: Callable[[int], str] = "{:06d}.png".format,
) -> DetectionSet:
    """Segment (frame number, BGR image) pairs.

    `progress` is called with each frame's number when it is done; `file_name` tells what the file of a frame is called.
    """
    numbers = {name: i + 1 for i, name in enumerate(segmenter.names)}
    images: list[ImageEntry] = []
    detections: list[Detection] = []
    for frame, image in frames:
        height, width = image.shape[:2]
        images.append(ImageEntry(frame, file_name(frame), width, height))
        detections += segment_frame(frame, image, segmenter, first_id=len(detections) + 1)
        if progress:
            progress(frame)
    points = segmenter.keypoint_names
    categories = tuple(CategoryEntry(number, name, points) for name, number in numbers.items())
    return DetectionSet(tuple(images), categories, tuple(detections))


def segment_frame(frame: int, image: Bytes, segmenter: Segmenter, first_id: int) -> list[Detection]:
    """Detections in one BGR image (h, w, 3), numbered from `first_id`."""
    found = segmenter.segment(image)
    return [_detection(first_id + k, frame, instance, image.shape[:2]) for k, instance in enumerate(found)]


def _detection(number: int, frame: int, instance: Instance, image_size: tuple[int, ...]) -> Detection:
    code, (height, width) = encode_mask(instance.mask), image_size
    found = Detection(number, frame, instance.name, instance.score, instance.bbox, code, (height, width))
    points, scores, track = instance.keypoints, instance.keypoint_scores, instance.track_id
    return replace(found, keypoints=points, keypoint_scores=scores, track_id=track)
