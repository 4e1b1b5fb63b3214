"""Damaged files: every reader of detections reads them or says in one short line what is wrong, and nothing else."""

import copy
import json
import os
import random

import numpy as np
import pytest

from meshslam.errors import MeshslamError
from meshslam.geometry import Camera
from meshslam.perception import (
    ImageFrames,
    check_detections,
    encode_mask,
    from_coco,
    from_coco_results,
    from_mots_txt,
    from_yolo_txt,
    read_detections,
    read_recorded_detections,
    write_detections,
)
from meshslam.perception.adapter import read_adapter
from meshslam.perception.network_range import expects_bytes
from meshslam.sequences import Report, Sequence
from tests.perception.networks import colour_network

WIDTH, HEIGHT = 32, 24
LONGEST = 300  # characters of a message behind the file's path
MUTATIONS = int(os.environ.get("MESHSLAM_MUTATIONS", "400"))  # of each reader; `make fuzz` takes more, and other seeds
SEED = int(os.environ.get("MESHSLAM_FUZZ_SEED", "0"))
FRAMES = ImageFrames((0, 1, 2), WIDTH, HEIGHT)

DEEP = "a list in 900 others"  # put in when the file is written
VALUES = [
    *(None, True, False, 0, 1, -1, 2, 3, 0.5, -0.0, 1e308, -1e308, 1e-320, float("nan"), float("inf"), 10**400),
    *(-(10**400), 2**53, 2**63, 2**64, 10**4000, "", "a", "car", "1", "\ud800", "x" * 5000, "\n\u2028\x00", [], {}),
    *([[]], [[0] * 6], [[1e308] * 6], [[10**400] * 6], [0] * 300, ["a", "a"], {"size": [HEIGHT, WIDTH]}, DEEP),
    *({"size": [HEIGHT, WIDTH], "counts": "o" * 500}, {"size": [10**9, 10**9], "counts": [10**18]}, [1, 2, 3, 4]),
    *({"size": [HEIGHT, WIDTH], "counts": [2**62, 2**62, 2**62, 2**62]}, [1e308, 1e308, 1e308, 1e308]),
]
WORDS = [
    "",
    "nan",
    "inf",
    "-inf",
    "1e308",
    "1e309",
    "-1",
    "0",
    "1",
    "2",
    "0.5",
    "x",
    "9" * 5000,
    "1e400",
    "\x00",
    "1_0",
]


def document():
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[5:15, 4:20] = 1
    common = {"bbox": [4, 5, 16, 10], "category_id": 1, "score": 0.9, "segmentation": encode_mask(mask)}
    points = {"keypoints": [5, 6, 2, 7, 8, 1], "keypoint_scores": [0.9, 0.4], "keypoint_sigmas_px": [1, 2]}
    plain = {"size": [HEIGHT, WIDTH], "counts": [100, 20, HEIGHT * WIDTH - 120]}
    return {
        "images": [{"id": i, "file_name": f"{i:06d}.png", "width": WIDTH, "height": HEIGHT} for i in range(3)],
        "categories": [{"id": 1, "name": "car", "keypoints": ["a", "b"]}, {"id": 2, "name": "person"}],
        "annotations": [
            common | points | {"id": 1, "image_id": 0, "track_id": 1, "viewing_angle_shares": [1, 2, 3, 4]},
            common | {"id": 2, "image_id": 1, "track_id": 1, "segmentation": [[4, 5, 20, 5, 20, 15]], "iscrowd": 1},
            common | {"id": 3, "image_id": 1, "track_id": 2, "segmentation": plain, "category_id": 2},
        ],
    }


def as_json(tree):
    nested = "[" * 900 + "]" * 900
    return json.dumps(tree).replace(json.dumps(DEEP), nested)


def places(node, before=()):
    """Every place of a JSON tree."""
    yield before
    children = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, child in children:
        yield from places(child, (*before, key))


def mutated(tree, random_):
    """One or two values of a tree changed, removed or repeated."""
    tree = copy.deepcopy(tree)
    for _ in range(random_.choice((1, 1, 2))):
        every = [place for place in places(tree) if place]
        if not every:
            break
        *parents, last = random_.choice(every)
        node = tree
        for parent in parents:
            node = node[parent]
        action = random_.random()
        if action < 0.1:
            del node[last]
        elif action < 0.2 and isinstance(node, list):
            node.append(copy.deepcopy(node[last]))
        else:
            node[last] = copy.deepcopy(random_.choice(VALUES))
    return tree


def damaged(content, random_):
    """Bytes flipped, cut out or put in."""
    data = bytearray(content)
    for _ in range(random_.choice((1, 1, 3))):
        at = random_.randrange(max(1, len(data)))
        if random_.random() < 0.5:
            data[at : at + 1] = bytes([random_.randrange(256)])
        elif random_.random() < 0.5:
            del data[at : at + random_.randrange(1, 40)]
        else:
            data[at:at] = random_.choice((b"[", b"}", b"9" * 5000, b"\xff\xfe", b"[" * 3000, b"-", b"e999"))
    return bytes(data)


def changed_words(text, random_):
    lines = [line.split(" ") for line in text.splitlines()]
    for _ in range(random_.choice((1, 1, 2))):
        words = random_.choice(lines)
        at = random_.randrange(len(words))
        action = random_.random()
        if action < 0.15 and len(words) > 1:
            del words[at]
        elif action < 0.3:
            words.insert(at, random_.choice(WORDS))
        else:
            words[at] = random_.choice(WORDS)
    return "\n".join(" ".join(words) for words in lines)


def sequence(folder):
    camera = Camera(WIDTH, HEIGHT, 30.0, 30.0, 16.0, 12.0)
    return Sequence("s", "folder", folder, camera, (0, 1, 2), np.arange(3) * 0.1)


def hold(read, path):
    """Read; a message of one short line is all that may come out instead."""
    try:
        found = read()
    except MeshslamError as error:
        said = str(error).replace(str(path.parent), "")
        assert len(said) <= LONGEST, said
        assert said.isprintable(), said
        return False
    if found is not None:
        assert read_back(found, path)
    return True


def read_back(found, path):
    """What was read is usable, and what is written of it can be read."""
    assert all(np.isfinite(d.bbox).all() and d.mask().shape == d.image_size for d in found.detections)
    assert all(len(note.replace(str(path.parent), "")) <= LONGEST and note.isprintable() for note in found.warnings)
    written = path.with_name("written.json")
    written.write_bytes(write_detections(found))
    return len(read_detections(written).detections) == len(found.detections)


@pytest.mark.parametrize("kind", ["values", "bytes"])
def test_damaged_detection_files(tmp_path, kind):
    random_, path, recording = random.Random(SEED + 1), tmp_path / "detections.json", sequence(tmp_path)
    content, read = json.dumps(document()).encode(), 0
    for _ in range(MUTATIONS):
        if kind == "values":
            path.write_bytes(as_json(mutated(document(), random_)).encode())
        else:
            path.write_bytes(damaged(content, random_))
        read += hold(lambda: read_detections(path), path)
        runs = hold(lambda: read_recorded_detections(path, recording), path)
        report = Report(collect=True)
        check_detections(path, recording, report)
        assert runs == all(p.severity == "note" for p in report.problems)
        assert all(len(p.what) <= LONGEST and p.what.isprintable() for p in report.problems)
    assert 0.02 * MUTATIONS < read < 0.9 * MUTATIONS


def test_damaged_results(tmp_path):
    random_, path = random.Random(SEED + 2), tmp_path / "results.json"
    rows = [{"image_id": a["image_id"], "category_id": 3} | a for a in document()["annotations"]]
    for _ in range(MUTATIONS):
        path.write_text(as_json(mutated(rows, random_)))
        hold(lambda: from_coco_results(path, FRAMES), path)


def tool_document():
    """With what labelling tools add: videos, tracks, attributes, boxes without masks, masks by file."""
    tree = document()
    for image in tree["images"]:
        image |= {"video_id": 1, "frame_index": image["id"], "extra": {"name": image["file_name"]}}
    tree |= {
        "videos": [
            {"id": 1, "name": "a", "file_names": ["a/000000.png", "a/000001.png"], "width": WIDTH, "height": HEIGHT}
        ]
    }
    tree["tracks"] = [{"id": 1, "category_id": 1, "video_id": 1}]
    for row in tree["annotations"]:
        row |= {"attributes": {"track_id": row.pop("track_id"), "score": 0.5}, "video_id": 1}
    tree["annotations"][2] |= {"segmentation": [], "id": 1}
    return tree


def test_damaged_documents_of_tools(tmp_path):
    random_, path, recording = random.Random(SEED + 4), tmp_path / "labels.json", sequence(tmp_path)
    listed = tool_document()
    listed["annotations"] = [
        {"id": 1, "video_id": 1, "category_id": 1, "segmentations": [None, [[4, 5, 20, 5, 20, 15]]]}
    ]
    read = 0
    for number in range(MUTATIONS):
        path.write_text(as_json(mutated(listed if number % 3 == 0 else tool_document(), random_)))
        video = "a" if number % 2 else None
        read += hold(lambda video=video: from_coco(path, recording, FRAMES, video=video), path)
    assert read > 0.2 * MUTATIONS


ADAPTER = {
    "input": {"size": [64, 64], "scale": "0-1", "mean": [0, 0, 0], "std": [1, 1, 1], "channels": "bgr", "fill": 3},
    "outputs": {
        "boxes": {"output": "a", "columns": [0, 4], "transposed": True, "format": "xywh", "normalised": True},
        "scores": {"output": "b", "kind": "logits", "background": "last"},
        "labels": {"output": "c", "first": 1},
        "masks": {"output": "d", "kind": "prototypes", "values": "logits"},
        "coefficients": {"output": "e"},
    },
    "classes": ["car", "bus"],
}


@pytest.mark.parametrize("kind", ["values", "bytes"])
def test_damaged_adapters(tmp_path, kind):
    random_, path = random.Random(SEED + 5), tmp_path / "net.adapter.yaml"

    def read():
        read_adapter(path)

    for _ in range(MUTATIONS):
        if kind == "values":
            path.write_text(as_json(mutated(ADAPTER, random_)))
        else:
            path.write_bytes(damaged(json.dumps(ADAPTER).encode(), random_))
        hold(read, path)


def test_damaged_networks(tmp_path):
    random_, path = random.Random(SEED + 6), tmp_path / "net.onnx"
    content = colour_network(path).read_bytes()
    for _ in range(MUTATIONS // 4):
        path.write_bytes(damaged(content, random_))
        assert expects_bytes(path, "images") in (True, False)


YOLO = "2 0.1 0.2 0.5 0.2 0.5 0.6 0.74 1\n2 0.2 0.3 0.6 0.3 0.6 0.8 0.3 0.8 0.5 2\n0 0.2 0.3 0.6 0.3 0.6 0.8 0.4"
MOTS = f"0 1001 1 24 32 {encode_mask(np.eye(24, 32, dtype=np.uint8))['counts']}\n1 -1 1 24 32 0P80"


@pytest.mark.parametrize("kind", ["words", "bytes"])
@pytest.mark.parametrize("source", ["yolo", "mots"])
def test_damaged_text_files(tmp_path, source, kind):
    random_, path = random.Random(SEED + 3), tmp_path / "000001.txt"
    text = YOLO if source == "yolo" else MOTS
    for _ in range(MUTATIONS):
        if kind == "words":
            path.write_text(changed_words(text, random_))
        else:
            path.write_bytes(damaged(text.encode(), random_))
        if source == "yolo":
            options = random_.choice(
                ({}, {"shape": "segment"}, {"shape": "boxes"}, {"shape": "pose"}, {"tracked": True})
            )
            hold(lambda options=options: from_yolo_txt(tmp_path, FRAMES, **options), path)
        else:
            hold(lambda: from_mots_txt(path, FRAMES), path)
