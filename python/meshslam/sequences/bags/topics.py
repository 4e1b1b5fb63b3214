"""Which topic is the image, the calibration, the IMU and the poses: what was named, else the only one there is."""

from __future__ import annotations

from collections.abc import Mapping

from meshslam.sequences.bags.index import BagIndex, Topic
from meshslam.sequences.bags.kinds import Kind
from meshslam.sequences.bags.pixels import is_depth
from meshslam.sequences.report import Report, fail

_WORDS: dict[Kind, str] = {
    "image": "images",
    "camera": "calibrations (CameraInfo)",
    "imu": "IMU samples",
    "poses": "poses",
    "transforms": "transforms",
}


def image_topic(index: BagIndex, named: Mapping[str, str], report: Report) -> Topic:
    """The image topic; FoundError where there is none, or more than one and none is named."""
    if "image" in named:
        return _named(index, "image", named["image"])
    every = index.of("image")
    found = [topic for topic in every if not is_depth(topic.form)]
    if every and not found:
        held = ", ".join(f"{topic.name} ({topic.form[:30]})" for topic in every)
        raise fail(index.path, "", f"only depth images are there, {held}: a camera's images are needed")
    if len(found) == 1:
        report.note(index.path, found[0].name, f"the only topic with images: {found[0].count} are taken as the frames")
        return found[0]
    if not found:
        there = ", ".join(f"{t.name} ({t.channel.type_name})" for t in index.topics.values())
        broken = next((t.why for t in index.topics.values() if t.kind == "image"), "")
        raise fail(
            index.path, "", f"no topic holds images{f' that can be read: {broken}' if broken else ''}; it has {there}"
        )
    names = ", ".join(topic.name for topic in found)
    raise fail(index.path, "", f"{len(found)} topics hold images, {names}: choose by --topic image={found[0].name}")


def camera_topic(index: BagIndex, named: Mapping[str, str], image: Topic) -> Topic | None:
    """The calibration in the image's namespace, or of its frame, or the only one; None where none tells."""
    if "camera" in named:
        return _named(index, "camera", named["camera"])
    found = index.of("camera")
    near = [t for t in found if _namespace(t.name) in _namespaces(image.name)]
    same = [t for t in found if t.frame and t.frame == image.frame]
    choices = (near, same, found if len(index.of("image")) == 1 else [])
    return next((few[0] for few in choices if len(few) == 1), None)


def imu_topic(index: BagIndex, named: Mapping[str, str], report: Report) -> Topic | None:
    """The IMU's topic; of several none is taken unless one is named, which is noted."""
    return _only(index, "imu", named, report)


def poses_topic(index: BagIndex, named: Mapping[str, str], report: Report) -> Topic | None:
    """The poses' topic; of several none is taken unless one is named, which is noted."""
    return _only(index, "poses", named, report)


def _only(index: BagIndex, kind: Kind, named: Mapping[str, str], report: Report) -> Topic | None:
    if kind in named:
        return _named(index, kind, named[kind])
    found = index.of(kind)
    if len(found) > 1:
        names = ", ".join(topic.name for topic in found)
        what = (
            f"{len(found)} topics hold {_WORDS[kind]}, {names}: none is taken, choose by --topic {kind}={found[0].name}"
        )
        report.note(index.path, "", what)
    if len(found) != 1:
        return None
    report.note(index.path, found[0].name, f"the only topic with {_WORDS[kind]}: taken")
    return found[0]


def _named(index: BagIndex, kind: Kind, name: str) -> Topic:
    topic = index.topics.get(name) or index.topics.get("/" + name)
    if topic is not None and kind == "image" and is_depth(topic.form):
        others = ", ".join(t.name for t in index.of("image") if not is_depth(t.form)) or "none"
        what = f"its images are {topic.form[:40]}: depth, not what a camera sees"
        raise fail(index.path, f"--topic {kind}={name}", f"{what}; topics with images are {others}")
    if topic is not None and topic.kind == kind and topic.count > topic.unreadable:
        return topic
    there = ", ".join(t.name for t in index.of(kind)) or "none"
    found = "no such topic" if topic is None else f"its type is {topic.channel.type_name}"
    if topic is not None and topic.unreadable:
        found = f"none of its messages can be read: {topic.why}"
    raise fail(index.path, f"--topic {kind}={name}", f"{found}; topics with {_WORDS[kind]} are {there}")


def _namespace(name: str) -> str:
    return name.rpartition("/")[0]


def _namespaces(name: str) -> set[str]:
    """Where a calibration may stand: beside the image, or beside what its transport's topic is made of."""
    own = _namespace(name)
    return {own, _namespace(own)} if name.rpartition("/")[2].startswith("compressed") else {own}
