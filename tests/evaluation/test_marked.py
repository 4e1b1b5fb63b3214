import numpy as np
import pytest

from meshslam.errors import SequenceError
from meshslam.evaluation.marked import marked_labels, marked_objects, score_marked
from meshslam.geometry import Pose
from meshslam.maps import Map, MapObject

LABEL = "{frame} {track} {kind} 0 0 0 0 0 10 10 1.5 1.8 4.2 {x} {y} {z} 0.1\n"
FORWARD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)


def camera(frame):
    return Pose(FORWARD, np.array([1.0 * frame, 0.0, 1.65]))


def labels(folder):
    """A parked car at (20, -3), one that drives, one that is seen twice, a cyclist."""
    rows = []
    for frame in range(10):
        rows.append(LABEL.format(frame=frame, track=0, kind="Car", x=3.0, y=1.65, z=20.0 - frame))
        rows.append(LABEL.format(frame=frame, track=1, kind="Car", x=-3.0, y=1.65, z=20.0))
        rows.append(LABEL.format(frame=frame, track=2, kind="Cyclist", x=5.0, y=1.65, z=20.0 - frame))
    rows += [LABEL.format(frame=f, track=3, kind="Van", x=4.0, y=1.65, z=30.0 - f) for f in (0, 1)]
    (folder / "labels.txt").write_text("".join(rows))
    return folder / "labels.txt"


def thing(number, x, y):
    pose = Pose.from_yaw(0.0, np.array([x, y, 0.7]))
    return MapObject(number, "car", pose, CUBE, np.array([[0, 1, 2], [1, 2, 3]]))


def test_labels_of_parked_cars_are_places_in_the_world(tmp_path):
    places = marked_labels(labels(tmp_path), {frame: camera(frame) for frame in range(10)})
    np.testing.assert_allclose(places, [[20.0, -3.0, 0.75]], atol=1e-9)


def test_a_damaged_line_is_named(tmp_path):
    path = labels(tmp_path)
    path.write_text(path.read_text() + "0 1 Car what\n")
    with pytest.raises(SequenceError, match=r"labels\.txt: line 33"):
        marked_labels(path, {0: camera(0)})
    with pytest.raises(SequenceError, match=r"none\.txt"):
        marked_labels(tmp_path / "none.txt", {})


def test_marks_and_objects_are_matched_one_to_one():
    marks = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [30.0, 0.0, 0.0]])
    score = score_marked(marks, Map((thing(1, 1.0, 0.0), thing(2, 10.0, 3.0), thing(3, 80.0, 0.0))))
    assert score.figures() == {"marked": 3, "reconstructed": 2, "position_error_mean_m": 2.0}
    assert score_marked(marks, Map(())).figures() == {"marked": 3, "reconstructed": 0}


def test_a_sequence_without_objects_has_no_marks(tmp_path):
    assert marked_objects(tmp_path) is None
