"""What a live run says of its counts."""

from array import array

import pytest

from meshslam.live import LiveCounts
from meshslam.runs.live_run import count_notes

FINE = {"frames": 100, "taken_in": 90, "skipped": 10, "segmented": 50, "latencies_s": array("f", [0.04] * 100)}


def test_a_run_that_kept_up_says_nothing():
    assert count_notes(LiveCounts(**FINE), 0.04) == []


@pytest.mark.parametrize(
    ("count", "said"),
    [
        ({"segmented": 10}, "reached 10 of 100 frames only"),
        ({"taken_in": 40}, "took in 40 of 100 frames"),
        ({"failed": 3}, "3 frames could not be taken in"),
        ({"perceptions_failed": 2}, "2 images or detections could not be used"),
        ({"too_late": 4}, "4 segmented frames had left the window"),
        ({"imu_left_out": 5}, "5 IMU samples were left out"),
        ({"dropped_poses": 6}, "6 poses were not taken in time"),
        ({"latencies_s": array("f", [0.04] * 90 + [0.5] * 10)}, "5% of the poses came 0.50 s after"),
    ],
)
def test_what_fell_short_is_one_note(count, said):
    (note,) = count_notes(LiveCounts(**(FINE | count)), 0.04)
    assert said in note
