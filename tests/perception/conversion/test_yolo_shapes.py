"""YOLO's text in all its shapes: polygons, boxes and poses, with confidence, track, both or neither."""

import itertools

import numpy as np
import pytest

from meshslam.errors import DetectionError
from meshslam.perception import ImageFrames, from_yolo_txt

FRAMES = ImageFrames((0, 1, 2, 3), 640, 480)
CORNERS = 8  # of a polygon


def polygon(rng, corners=CORNERS):
    """A ring, as outlines are written."""
    angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
    centre, radius = rng.uniform(0.3, 0.7, 2), rng.uniform(0.05, 0.2, 2)
    return (centre + radius * np.stack([np.cos(angle), np.sin(angle)], 1)).ravel()


def pose(rng, each, points=12):
    """A box with key points that fill it; some are not seen."""
    centre, size = rng.uniform(0.3, 0.7, 2), rng.uniform(0.1, 0.3, 2)
    places = centre + size * rng.uniform(-0.48, 0.48, (points, 2))
    places[0], places[1] = centre - 0.48 * size, centre + 0.48 * size
    values = np.column_stack([places, rng.uniform(0.5, 1, points)]) if each == 3 else places
    return np.concatenate([centre, size, values.ravel()])


def box(rng):
    return np.concatenate([rng.uniform(0.3, 0.7, 2), rng.uniform(0.1, 0.3, 2)])


def text_of(values, score, track):
    """As Ultralytics writes a line: %g, the track last."""
    ends = ([] if score is None else [score]) + ([] if track is None else [track])
    return " ".join(f"{v:g}" for v in (2, *values, *ends))


def write(folder, shape, with_score, with_track, count=3):
    rng = np.random.default_rng(7)
    for frame in range(2):
        lines = [
            text_of(shape(rng), 0.5 + 0.1 * k if with_score else None, k + 1 if with_track else None)
            for k in range(count)
        ]
        (folder / f"drive_{frame}.txt").write_text("\n".join(lines) + "\n")


def area_of(values):
    x, y = np.reshape(values, (-1, 2)).T * np.array([[640], [480]])
    return abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1))) / 2


ENDS = list(itertools.product((True, False), repeat=2))


@pytest.mark.parametrize(("with_score", "with_track"), ENDS)
@pytest.mark.parametrize("count", [1, 3])
def test_polygons_have_their_corners_and_no_others(tmp_path, with_score, with_track, count):
    write(tmp_path, polygon, with_score, with_track, count)
    found = from_yolo_txt(tmp_path, FRAMES).detections
    assert [d.track_id for d in found] == [k + 1 if with_track else None for _ in range(2) for k in range(count)]
    assert [d.score for d in found] == pytest.approx(
        [0.5 + 0.1 * k if with_score else 1 for _ in range(2) for k in range(count)]
    )
    rng = np.random.default_rng(7)
    for detection in found:
        assert len(detection.segmentation[0]) == 2 * CORNERS
        assert detection.area_px == pytest.approx(area_of(polygon(rng)), rel=0.1)


@pytest.mark.parametrize(("with_score", "with_track"), ENDS)
@pytest.mark.parametrize("each", [2, 3])
def test_poses_are_no_polygons_and_their_boxes_are_taken_if_asked_for(tmp_path, each, with_score, with_track):
    def shape(rng):
        return pose(rng, each)

    write(tmp_path, shape, with_score, with_track)
    with pytest.raises(DetectionError, match=r"drive_0\.txt:1: key points and no masks: --yolo pose"):
        from_yolo_txt(tmp_path, FRAMES)
    found = from_yolo_txt(tmp_path, FRAMES, shape="pose")
    check_boxes(found, shape, with_score, with_track)
    assert sum("key points have no names" in note for note in found.warnings) == 1


@pytest.mark.parametrize(("with_score", "with_track"), ENDS)
def test_boxes_are_taken_for_masks_if_asked_for(tmp_path, with_score, with_track):
    write(tmp_path, box, with_score, with_track)
    with pytest.raises(DetectionError, match=r"drive_0\.txt:1: a box, no masks.*--yolo boxes"):
        from_yolo_txt(tmp_path, FRAMES)
    check_boxes(from_yolo_txt(tmp_path, FRAMES, shape="boxes"), box, with_score, with_track)


def check_boxes(found, shape, with_score, with_track):
    assert any("boxes are taken for masks (6)" in note for note in found.warnings)
    assert [d.track_id for d in found.detections] == [k + 1 if with_track else None for _ in range(2) for k in range(3)]
    assert [d.score for d in found.detections] == pytest.approx([0.5, 0.6, 0.7] * 2 if with_score else [1] * 6)
    rng = np.random.default_rng(7)
    for detection in found.detections:
        x, y, w, h = shape(rng)[:4] * [640, 480, 640, 480]
        assert detection.bbox == pytest.approx((x - w / 2, y - h / 2, w, h), abs=1.5)


def test_tracks_that_begin_with_0_are_no_corners(tmp_path):
    rng = np.random.default_rng(1)
    lines = [text_of(polygon(rng), 0.9, k) for k in (0, 1)]
    (tmp_path / "0.txt").write_text("\n".join(lines))
    assert [d.track_id for d in from_yolo_txt(tmp_path, FRAMES).detections] == [0, 1]


AT_BORDER = "2 0.1 0.9 0.3 0.9 0.3 1 0.2 1"


def test_what_may_be_a_corner_or_a_track_is_said_and_asked(tmp_path):
    (tmp_path / "0.txt").write_text(AT_BORDER)
    found = from_yolo_txt(tmp_path, FRAMES)
    assert found.detections[0].track_id is None
    assert any("ends in 0.2 1, read as a polygon's corner: --tracked says" in note for note in found.warnings)
    told = from_yolo_txt(tmp_path, FRAMES, tracked=True).detections[0]
    assert (told.track_id, told.score, len(told.segmentation[0])) == (1, 0.2, 6)
    assert not any("--tracked" in note for note in from_yolo_txt(tmp_path, FRAMES, tracked=False).warnings)


def test_a_confidence_of_1_is_a_track_only_if_it_is_said(tmp_path):
    rng = np.random.default_rng(1)
    (tmp_path / "0.txt").write_text(text_of(polygon(rng), 1, None))
    assert from_yolo_txt(tmp_path, FRAMES, tracked=False).detections[0].track_id is None
    assert from_yolo_txt(tmp_path, FRAMES, tracked=True).detections[0].track_id == 1


def test_frames_before_a_tracker_knows_its_objects_have_no_ids(tmp_path):
    """Ultralytics leaves the id out there."""
    rng = np.random.default_rng(3)
    (tmp_path / "0.txt").write_text(text_of(polygon(rng), 0.9, None))
    (tmp_path / "1.txt").write_text(text_of(polygon(rng), 0.8, 1) + "\n" + text_of(polygon(rng, 9), 0.7, 2))
    found = from_yolo_txt(tmp_path, FRAMES).detections
    assert [(d.score, d.track_id) for d in found] == [(0.9, None), (0.8, 1), (0.7, 2)]


def test_polygons_of_one_count_are_no_poses(tmp_path):
    """Four corners, also rectangles, as labelling tools draw them."""
    rng = np.random.default_rng(5)
    for frame in range(4):
        lines = []
        for _ in range(3):
            (x, y), (w, h) = rng.uniform(0.05, 0.6, 2), rng.uniform(0.05, 0.3, 2)
            lines.append(text_of([x, y, x + w, y, x + w, y + h, x, y + h], None, None))
        (tmp_path / f"{frame}.txt").write_text("\n".join(lines))
    assert len(from_yolo_txt(tmp_path, FRAMES).detections) == 12
    for seed in range(60):
        (tmp_path / "0.txt").write_text(text_of(polygon(np.random.default_rng(seed), 4 + seed % 20), 0.5, None))
        for frame in (1, 2, 3):
            (tmp_path / f"{frame}.txt").write_text("")
        assert len(from_yolo_txt(tmp_path, FRAMES).detections) == 1


@pytest.mark.parametrize(
    ("line", "options", "said"),
    [
        (AT_BORDER, {"shape": "boxes"}, "found 9 numbers, expected a class, a box, score and track at most"),
        (f"{AT_BORDER} 0.4 0.5 0.5", {"shape": "pose"}, "--yolo pose: lines are no boxes with key points"),
        (f"{AT_BORDER} 0.9 1.5", {"tracked": True}, "track 1.5: expected an integer"),
        ("2 0.5 0.5", {"shape": "boxes"}, "found 3 numbers"),
        ("2 0.5 0.5 7 0.5", {"shape": "boxes"}, "must lie between 0 and 1"),
    ],
)
def test_lines_that_are_not_what_was_said_are_named(tmp_path, line, options, said):
    (tmp_path / "0.txt").write_text(line)
    with pytest.raises(DetectionError, match=r"0\.txt:1: ") as caught:
        from_yolo_txt(tmp_path, FRAMES, **options)
    assert said in str(caught.value)
