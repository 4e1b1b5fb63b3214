"""Instance segmentation by ONNX Runtime: images in, detections out."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

from meshslam.errors import ModelError
from meshslam.geometry import Bytes
from meshslam.perception.detections import CategoryEntry, Detection, DetectionSet, ImageEntry
from meshslam.perception.instances import Instance, Segmenter, SegmenterConfig, first_line
from meshslam.perception.mask_rcnn import MaskRcnnSegmenter, recognize_mask_rcnn
from meshslam.perception.masks import encode_mask
from meshslam.perception.yolo_segmenter import YoloSegmenter


def load_segmenter(path: Path, config: SegmenterConfig | None = None, threads: int = 2) -> Segmenter:
    """Load a network for instance segmentation; its layout is told from its outputs' shapes.

    Known are YOLO-seg (v5, v8, 11) and Mask R-CNN (torchvision, ONNX model zoo).

    Raises ModelError if the file cannot be loaded or its inputs, outputs or class names fit no known layout.
    """
    import onnxruntime  # slow to import: only those who segment wait for it

    path = Path(path)
    if not path.is_file():
        raise ModelError(f"{path}: no such file, expected an ONNX export of an instance segmentation network")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    options.log_severity_level = 3
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # spinning threads starve other processes
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # the runtime's own exceptions have no common base but this
        raise ModelError(f"{path}: cannot be loaded as an ONNX model: {first_line(error)}") from None
    layout = recognize_mask_rcnn(session)
    if layout is not None:
        return MaskRcnnSegmenter(path, session, layout, config or SegmenterConfig())
    return YoloSegmenter(path, session, config or SegmenterConfig())


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
