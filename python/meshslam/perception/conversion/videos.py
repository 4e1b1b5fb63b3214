"""Documents of several videos: TAO's with images and tracks, YouTube-VIS's with a list of masks for each object."""

from __future__ import annotations

from typing import Any

from meshslam.errors import DetectionError
from meshslam.perception.faults import Faults
from meshslam.perception.json_values import is_name, quoted

Row = dict[str, Any]


def without_videos(root: Row, chosen: str | None, faults: Faults) -> Row:
    """The images and annotations of one video, as plain COCO; a document without videos as it is."""
    videos = root.get("videos")
    if not isinstance(videos, list) or not videos or not all(isinstance(v, dict) for v in videos):
        if chosen is not None:
            raise DetectionError(f"{faults.path}: --video: the file has no videos: leave it out")
        return root
    video = _chosen(videos, chosen, faults)
    rows = root.get("annotations")
    listed = [row for row in rows if isinstance(row, dict)] if isinstance(rows, list) else []
    if any("segmentations" in row for row in listed):
        mine = [row for row in listed if row.get("video_id") == video.get("id")]
        return _of_lists(root, video, mine, faults)
    return _of_images(root, video, listed)


def _chosen(videos: list[Row], chosen: str | None, faults: Faults) -> Row:
    names = [_name(video) for video in videos]
    found = [v for v, name in zip(videos, names, strict=True) if chosen is None or chosen in (name, str(v.get("id")))]
    if len(found) == 1:
        return found[0]
    listed = f"{', '.join(names[:5])[:120]}{' …' if len(names) > 5 else ''}"
    if chosen is None:
        raise DetectionError(f"{faults.path}: holds {len(videos)} videos: choose one with --video NAME: {listed}")
    raise DetectionError(
        f"{faults.path}: --video {quoted(chosen)}: {len(found)} videos have this name, there are {listed}"
    )


def _name(video: Row) -> str:
    names = video.get("file_names")
    folder = str(names[0]).rpartition("/")[0] if isinstance(names, list) and names else ""
    name = video.get("name")
    return quoted(name if is_name(name) and name else folder or video.get("id")).strip('"')


def _of_images(root: Row, video: Row, rows: list[Row]) -> Row:
    """TAO's: images and tracks name their video; a track has its category."""
    images = root.get("images")
    if not isinstance(images, list):
        return root
    mine = [i for i in images if not isinstance(i, dict) or i.get("video_id", video.get("id")) == video.get("id")]
    numbered = [_numbered(i) if isinstance(i, dict) else i for i in mine]
    ids = {i["id"] for i in mine if isinstance(i, dict) and type(i.get("id")) is int}
    tracks = root.get("tracks")
    listed = tracks if isinstance(tracks, list) else []
    category = {t["id"]: t.get("category_id") for t in listed if isinstance(t, dict) and type(t.get("id")) is int}
    found = []
    for row in rows:
        if type(row.get("image_id")) is int and row["image_id"] in ids:
            track = row.get("track_id")
            own = category.get(track) if type(track) is int else None
            found.append(row if "category_id" in row or own is None else row | {"category_id": own})
    return root | {"images": numbered, "annotations": found}


def _numbered(image: Row) -> Row:
    """With a name where it has none but a place in its video."""
    place = next((image[key] for key in ("frame_index", "frame_id") if type(image.get(key)) is int), None)
    return image if place is None or "file_name" in image else image | {"file_name": f"{place:06d}.png"}


def _of_lists(root: Row, video: Row, rows: list[Row], faults: Faults) -> Row:
    """YouTube-VIS's: an annotation is a track, with a mask or nothing for each file of its video."""
    names = video.get("file_names")
    files = names if isinstance(names, list) else []
    size = {"width": video.get("width"), "height": video.get("height")}
    images = [{"id": k, "file_name": name, **size} for k, name in enumerate(files)]
    found: list[Row] = []
    for row in rows:
        masks, boxes = row.get("segmentations"), row.get("bboxes")
        if not isinstance(masks, list) or len(masks) > len(files):
            place = f"{faults.path}: annotation {quoted(row.get('id'))}: segmentations"
            raise DetectionError(f"{place}: expected a mask or null for each of {len(files)} files")
        places = boxes if isinstance(boxes, list) and len(boxes) == len(masks) else [None] * len(masks)
        same: Row = {key: row[key] for key in ("category_id", "score") if key in row}
        for k, (mask, box) in enumerate(zip(masks, places, strict=True)):
            if mask is not None:
                number = len(found) + 1
                one = {"id": number, "image_id": k, "segmentation": mask, "track_id": row.get("id"), **same}
                found.append(one if box is None else one | {"bbox": box})
    return root | {"images": images, "annotations": found}
