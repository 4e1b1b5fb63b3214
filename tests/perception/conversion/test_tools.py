"""COCO documents as labelling tools write them: each with the structure of a file by the tool's own writer."""

import json
from pathlib import Path

import numpy as np
import pytest

from meshslam.errors import DetectionError
from meshslam.geometry import Camera
from meshslam.perception import (
    ImageFrames,
    encode_mask,
    from_coco,
    from_coco_results,
    read_detections,
    write_detections,
)
from meshslam.sequences import ImageFiles, Sequence

WIDTH, HEIGHT, COUNT = 64, 48, 3
FRAMES = ImageFrames(tuple(range(COUNT)), WIDTH, HEIGHT)
CORNERS = [30.0, 10.0, 40.0, 10.0, 40.0, 20.0, 30.0, 20.0]


def square(x=4, y=10, side=12):
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[y : y + side, x : x + side] = 1
    return mask


def plain_runs(mask):
    """Uncompressed run lengths, as datumaro and CVAT write them."""
    flat = mask.ravel(order="F")
    ends = np.flatnonzero(np.diff(flat)) + 1
    return {"size": [HEIGHT, WIDTH], "counts": np.diff([0, *ends, flat.size]).tolist()}


@pytest.fixture
def read(tmp_path):
    def given(document, **options):
        paths = tuple(Path("images", f"{n:06d}.png") for n in range(COUNT))
        camera = Camera(WIDTH, HEIGHT, 60.0, 60.0, 31.5, 23.5)
        times = np.arange(COUNT) * 0.1
        recording = Sequence(
            "s", "folder", Path("s"), camera, tuple(range(COUNT)), times, images=ImageFiles(tuple(paths))
        )
        path = tmp_path / "labels.json"
        path.write_text(json.dumps(document))
        found = from_coco(path, recording, options.pop("frames", FRAMES), **options)
        (tmp_path / "again.json").write_bytes(write_detections(found))
        assert len(read_detections(tmp_path / "again.json").detections) == len(found.detections)
        return found

    return given


def document(images, annotations, categories=("car", "van"), first=1):
    """`images` are pairs of id and file name."""
    return {
        "images": [{"id": i, "file_name": name, "width": WIDTH, "height": HEIGHT} for i, name in images],
        "categories": [{"id": i, "name": name} for i, name in enumerate(categories, first)],
        "annotations": [{"id": i, "iscrowd": 0, **row} for i, row in enumerate(annotations, 1)],
    }


def test_supervision_counts_images_from_1_and_boxes_are_a_pixel_short(read):
    rows = [
        {"image_id": n, "category_id": 1, "bbox": [4.0, 10.0, 11.0, 11.0], "area": 121.0, "segmentation": [CORNERS]}
        for n in (1, 2)
    ]
    found = read(document([(1, "000000.png"), (2, "000001.png")], rows))
    assert [(d.frame, d.category, d.score) for d in found.detections] == [(0, "car", 1.0), (1, "car", 1.0)]
    x, y, w, _ = found.detections[0].bbox
    assert (x, y) == (30, 10)
    assert w >= 10
    assert any("file_name, which outranks ids" in note for note in found.warnings)


def test_datumaro_and_cvat_mark_masks_as_crowds_and_put_tracks_into_attributes(read):
    """Datumaro also numbers the annotations of each image anew; file names may end otherwise."""
    near = square(6, 10)  # overlaps the first by more than half: a crowd would be left out
    rows = [
        {
            "image_id": 0,
            "category_id": 1,
            "iscrowd": 1,
            "segmentation": plain_runs(square()),
            "attributes": {"track_id": 7},
        },
        {
            "image_id": 0,
            "category_id": 2,
            "segmentation": plain_runs(near),
            "attributes": {"track_id": 9, "score": 0.4},
        },
        {
            "image_id": 1,
            "category_id": 1,
            "iscrowd": 1,
            "segmentation": plain_runs(near),
            "attributes": {"track_id": "7"},
        },
    ]
    given = document([(0, "000000.jpg"), (1, "000001.jpg")], rows)
    given["annotations"][2]["id"] = 1
    found = read(given)
    got = [(d.frame, d.category, d.track_id, d.score) for d in found.detections]
    assert got == [(0, "car", 7, 1.0), (0, "van", 9, 0.4), (1, "car", 7, 1.0)]
    assert (found.detections[0].mask() == square()).all()
    said = " ".join(found.warnings)
    for part in ("not crowds: 2", "numbered anew", "tracks are taken from attributes"):
        assert part in said


def test_crowds_of_coco_itself_stay_crowds(read):
    rows = [
        {"image_id": 0, "category_id": 1, "iscrowd": 1, "segmentation": plain_runs(square(2, 2, 40))},
        {"image_id": 0, "category_id": 1, "segmentation": [CORNERS]},
    ]
    assert len(read(document([(0, "000000.png")], rows)).detections) == 1


def test_label_studio_and_roboflow_change_the_files_names(read):
    names = ["\\/data\\/upload\\/1\\/3a4b5c6d-000001.png", "000002_png.rf.0a1B2c3D4e5.jpg"]
    rows = [{"image_id": i, "category_id": 0, "segmentation": [CORNERS]} for i in (0, 1)]
    found = read(document(enumerate(names), rows, first=0))
    assert [d.frame for d in found.detections] == [1, 2]
    assert any("names that a service made" in note for note in found.warnings)
    extra = document([(0, "anything.png")], rows[:1], first=0)
    extra["images"][0]["extra"] = {"name": "000002.png"}
    assert [d.frame for d in read(extra).detections] == [2]


def test_roboflows_first_category_is_used_by_nothing(read):
    rows = [{"image_id": 0, "category_id": 1, "segmentation": [CORNERS]}]
    found = read(document([(0, "000000.png")], rows, categories=("car", "car"), first=0))
    assert [c.name for c in found.categories] == ["car"]


def test_labelme2coco_writes_rectangles_without_masks(read):
    rows = [
        {"image_id": 1, "category_id": 0, "bbox": [4.0, 10.0, 12.0, 12.0], "segmentation": [], "area": 144},
        {"image_id": 1, "category_id": 0, "bbox": [30.0, 10.0, 10.0, 10.0], "segmentation": [CORNERS]},
        {"image_id": 1, "category_id": 0, "bbox": [50.0, 10.0, 10.0, 10.0], "segmentation": [[50, 10, 60, 20]]},
    ]
    found = read(document([(1, "images/000000.png")], rows, first=0))
    assert [d.area_px for d in found.detections] == [144, 100, 100]
    said = " ".join(found.warnings)
    assert "2 annotations without a mask: their box is taken for it (first: annotation 1)" in said
    assert "fewer than three points" in said


def test_sahis_results_name_their_classes(tmp_path):
    row = {"image_id": 1, "bbox": [4.0, 10.0, 11.0, 11.0], "score": 0.8, "category_id": 0, "category_name": "car"}
    row |= {"segmentation": [[4, 10, 15, 10, 15, 21, 4, 21]], "iscrowd": 0, "area": 121}
    path = tmp_path / "result.json"
    path.write_text(json.dumps([row, {**row, "image_id": "drive_000002"}]))
    found = from_coco_results(path, FRAMES)
    assert [(d.frame, d.category, d.score) for d in found.detections] == [(1, "car", 0.8), (2, "car", 0.8)]


def test_names_and_the_first_frames_number_outrank_the_file(read):
    rows = [{"image_id": n, "category_id": 1, "segmentation": [CORNERS]} for n in (1, 2)]
    given = document([(1, "frame_0001.png"), (2, "frame_0002.png")], rows)
    frames = ImageFrames(tuple(range(COUNT)), WIDTH, HEIGHT, first=1)
    found = read(given, frames=frames, names={1: "bus"})
    assert [(d.frame, d.category) for d in found.detections] == [(0, "bus"), (1, "bus")]


def tao(videos=("a",)):
    """Images and tracks that name their video; two images a video."""
    images = [
        {
            "id": 10 * v + k,
            "video_id": v,
            "file_name": f"val/{name}/{k:06d}.png",
            "width": WIDTH,
            "height": HEIGHT,
            "frame_index": k,
        }
        for v, name in enumerate(videos)
        for k in (0, 1)
    ]
    return {
        "videos": [{"id": v, "name": f"val/{name}", "width": WIDTH, "height": HEIGHT} for v, name in enumerate(videos)],
        "images": images,
        "categories": [{"id": 805, "name": "car", "synset": "car.n.01"}],
        "tracks": [{"id": 5 + v, "category_id": 805, "video_id": v} for v in range(len(videos))],
        "annotations": [
            {
                "id": n,
                "image_id": i["id"],
                "video_id": i["video_id"],
                "track_id": 5 + i["video_id"],
                "segmentation": [CORNERS],
            }
            for n, i in enumerate(images)
        ],
    }


def test_tao_has_videos_and_tracks(read):
    found = read(tao())
    assert [(d.frame, d.category, d.track_id) for d in found.detections] == [(0, "car", 5), (1, "car", 5)]
    second = read(tao(("a", "b")), video="val/b")
    assert [d.track_id for d in second.detections] == [6, 6]
    with pytest.raises(DetectionError, match=r"holds 2 videos: choose one with --video NAME: val/a, val/b"):
        read(tao(("a", "b")))
    with pytest.raises(DetectionError, match=r'--video "c": 0 videos have this name, there are val/a'):
        read(tao(("a", "b")), video="c")
    with pytest.raises(DetectionError, match="has no videos"):
        read(document([], []), video="c")


def test_youtube_vis_lists_a_mask_a_file(read):
    names = [f"drive/{k:06d}.png" for k in range(3)]
    given = {
        "videos": [{"id": 1, "width": WIDTH, "height": HEIGHT, "length": 3, "file_names": names}],
        "categories": [{"id": 1, "name": "car"}],
        "annotations": [
            {"id": 4, "video_id": 1, "category_id": 1, "segmentations": [None, encode_mask(square()), [CORNERS]]}
        ],
    }
    found = read(given)
    assert [(d.frame, d.track_id) for d in found.detections] == [(1, 4), (2, 4)]
    given["annotations"][0]["segmentations"] *= 2
    with pytest.raises(DetectionError, match="expected a mask or null for each of 3 files"):
        read(given)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"annotations": 3}, "annotations: found a number"),
        ({"annotations": [3]}, "annotations[0]"),
        (
            {"images": [{"id": 0, "file_name": "000000.png", "width": 640, "height": 640}]},
            "is 640x640, the camera's is",
        ),
        ({"categories": [{"id": 1}]}, "name: is missing"),
        ({"annotations": [{"id": 1, "image_id": 0, "category_id": 1}]}, "segmentation: is missing"),
        (
            {"annotations": [{"id": 1, "image_id": 0, "category_id": 1, "bbox": [0, 0, "a", 3]}]},
            "segmentation: is missing",
        ),
        (
            {"annotations": [{"id": 1, "image_id": 0, "category_id": 1, "segmentation": [["a"] * 6]}]},
            "no finite numbers",
        ),
        ({"images": [{"id": 0, "file_name": 3, "width": 64, "height": 48}]}, "file_name: found 3"),
    ],
)
def test_documents_that_are_wrong_are_named_in_one_line(read, change, said):
    with pytest.raises(DetectionError) as caught:
        read(document([(0, "000000.png")], [{"image_id": 0, "category_id": 1, "segmentation": [CORNERS]}]) | change)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
