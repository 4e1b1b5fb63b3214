"""Which frame of a recording an image of a detection file is: by `file_name`, which outranks ids, or by id."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from meshslam.perception.detections import ImageEntry
from meshslam.perception.faults import Faults
from meshslam.perception.json_values import quoted
from meshslam.sequences import Sequence

_LAST_NUMBER = re.compile(r"(\d{1,15})$", re.ASCII)


@dataclass(frozen=True)
class FrameMatch:
    """The images by frame, one for every frame of the recording; and the frame of each image id of the file."""

    images: tuple[ImageEntry, ...]
    of_image: Mapping[int, int]


def frames_of_images(
    images: tuple[ImageEntry, ...], named: Iterable[int], sequence: Sequence | None, faults: Faults
) -> FrameMatch:
    """Match images to the frames of a recording; without one, ids are the frames.

    `named` are the ids whose `file_name` was given. A name matches an image file of the recording by its last part,
    with or without its suffix; where no name does, numbers at the ends of the names do, if every one is a frame. Images
    of no frame or of another size are reported and left out.
    """
    if sequence is None:
        return FrameMatch(images, {i.id: i.id for i in images})
    names = {i.id: _last_part(i.file_name) for i in images}
    names = {id_: names[id_] for id_ in named if id_ in names}
    frame_of = _by_file(names, sequence) or _by_number(names, images, sequence)
    if any(id_ != frame for id_, frame in frame_of.items()):
        _tell(frame_of, names, faults)
    chosen = frame_of or {i.id: i.id for i in images}
    left_out = {_stem(name) for name in sequence.left_out_images}
    part = [
        i
        for i in images
        if chosen.get(i.id) not in sequence.left_out_frames
        and (i.id in frame_of or _stem(names.get(i.id, "")) not in left_out)
    ]
    frames = frozenset(sequence.frame_ids)
    fitting = [i for i in part if _fits(i, chosen, frames, sequence, faults, by_name=bool(frame_of))]
    matched = _one_a_frame([replace(i, id=chosen[i.id]) for i in fitting], faults)
    return FrameMatch(_whole(matched, sequence), {i.id: chosen[i.id] for i in fitting})


def _last_part(name: str) -> str:
    return re.split(r"[/\\]", name)[-1]


def _by_file(names: Mapping[int, str], sequence: Sequence) -> dict[int, int]:
    """Frames by the names of the recording's own images; empty if none matches."""
    own = () if sequence.images is None else sequence.images.names
    for part in (str, _stem):
        found = _table(part, own, sequence.frame_ids)
        matched = {id_: found[part(name)] for id_, name in names.items() if part(name) in found}
        if matched:
            return matched
    return {}


def _table(part: Callable[[str], str], names: Iterable[str], frames: Iterable[int]) -> dict[str, int]:
    return {part(name): frame for name, frame in zip(names, frames, strict=False)}


def _stem(name: str) -> str:
    return Path(name).stem


def _by_number(names: Mapping[int, str], images: tuple[ImageEntry, ...], sequence: Sequence) -> dict[int, int]:
    """Frames by the numbers that the names end with; empty unless every image has one, and each is a frame."""
    ends = {id_: _LAST_NUMBER.search(_stem(name)) for id_, name in names.items()}
    numbers = {id_: int(end.group()) for id_, end in ends.items() if end is not None}
    frames = {*sequence.frame_ids, *sequence.left_out_frames}
    whole = len(numbers) == len(images) == len(set(numbers.values()))
    return numbers if whole and all(n in frames for n in numbers.values()) else {}


def _tell(frame_of: Mapping[int, int], names: Mapping[int, str], faults: Faults) -> None:
    others = [id_ for id_, frame in frame_of.items() if frame != id_]
    first = others[0]
    faults.note(
        f"images are matched to frames by file_name, which outranks ids: {len(others)} of {len(frame_of)} have another "
        f"id than their frame (first: id {first} is {quoted(names[first])}, frame {frame_of[first]})"
    )


def _fits(
    image: ImageEntry,
    frame_of: Mapping[int, int],
    frames: Collection[int],
    sequence: Sequence,
    faults: Faults,
    *,
    by_name: bool,
) -> bool:
    """Whether an image is one of the recording's, and as large."""
    raw, before, where = sequence.raw_camera, faults.problem_count, f"images id {image.id}"
    if image.id not in frame_of:
        faults.add(where, f"file_name {quoted(image.file_name)} is no image of the recording, others of the file are")
    elif frame_of[image.id] not in frames:
        span = f"{sequence.frame_ids[0]} to {sequence.frame_ids[-1]}"
        hint = "" if by_name else "; a file_name would say which frame is meant"
        faults.add(where, f"no frame of that number; frames are {span}{hint}")
    if (image.width, image.height) != (raw.width, raw.height):
        faults.add(where, f"is {image.width}x{image.height}, the camera's is {raw.width}x{raw.height}")
    return faults.problem_count == before


def _one_a_frame(images: list[ImageEntry], faults: Faults) -> dict[int, ImageEntry]:
    found: dict[int, ImageEntry] = {}
    for image in images:
        if image.id in found:
            names = f"{quoted(found[image.id].file_name)} and {quoted(image.file_name)}"
            faults.add("images", f"two entries are frame {image.id}: {names}")
        found.setdefault(image.id, image)
    return found


def _whole(images: Mapping[int, ImageEntry], sequence: Sequence) -> tuple[ImageEntry, ...]:
    """The images with an entry for every frame that has none, by frame."""
    raw = sequence.raw_camera
    every = dict(images)
    for frame in sequence.frame_ids:
        every.setdefault(frame, ImageEntry(frame, f"{frame:06d}.png", raw.width, raw.height))
    return tuple(every[frame] for frame in sorted(every))
