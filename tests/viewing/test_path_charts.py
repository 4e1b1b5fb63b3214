import cv2
import numpy as np

from meshslam.geometry import Pose
from meshslam.maps import Map
from meshslam.viewing.path_charts import iterations_chart, lines_from_above, path_chart

PNG = b"\x89PNG"


def straight(count, aside_m):
    return tuple(Pose.from_yaw(0.0, [float(k), aside_m, 0.0]) for k in range(count))


def test_paths_keep_their_names_and_places():
    lines = lines_from_above(Map(()), {"truth": straight(4, 0.0), "estimate": straight(4, 0.5)})
    assert [line.name for line in lines] == ["estimate", "truth"]
    assert list(lines[0].x) == [0.0, 1.0, 2.0, 3.0]
    assert list(lines[0].y) == [0.5] * 4


def test_the_same_paths_give_the_same_picture():
    drawn = [path_chart(Map(()), {"estimate": straight(5, 1.0)}) for _ in range(2)]
    assert drawn[0].startswith(PNG)
    assert drawn[0] == drawn[1]
    assert path_chart(Map(()), {"estimate": straight(5, 2.0)[::-1]}) != drawn[0]


def test_iterations_are_drawn_where_the_figures_hold_some():
    assert iterations_chart({"ate_rmse_m": 0.2}) is None
    falling = {f"ate_iteration_{k:02d}_rmse_m": 1.0 / (k + 1) for k in range(5)}
    assert iterations_chart(falling).startswith(PNG)


def test_the_estimate_lies_below_the_others():
    lines = lines_from_above(Map(()), {"truth": straight(4, 0.0), "estimate": straight(4, 0.0)})
    assert [(line.name, line.wide) for line in lines] == [("estimate", True), ("truth", False)]
    picture = cv2.imdecode(
        np.frombuffer(path_chart(Map(()), {"truth": straight(40, 0.0), "estimate": straight(40, 0.0)}), np.uint8), 1
    )
    middle = picture[:, picture.shape[1] // 2].astype(int)
    colourful = np.ptp(middle, axis=1) > 60  # both the pale band and the line over it
    assert colourful.sum() >= 4
