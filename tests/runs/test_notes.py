import dataclasses

import numpy as np
import pytest

from meshslam.motion import ImuConfig
from meshslam.runs import heading_notes, imu_notes, object_notes, scale_notes
from meshslam.sequences import ImuSamples


def without(imu, begin_s, end_s):
    keep = (imu.times_s < begin_s) | (imu.times_s > end_s)
    return ImuSamples(imu.times_s[keep], imu.angular_rate_rad_s[keep], imu.specific_force_m_s2[keep])


def test_a_whole_recording_needs_no_note(drive, seen):
    assert imu_notes(drive, ImuConfig()) == []
    assert object_notes(drive, seen) == []
    assert scale_notes(drive) == []


@pytest.mark.parametrize(("begin", "end"), [(-1.0, 0.4), (0.5, 0.9), (1.1, 9.0)])
def test_missing_samples_are_said_with_their_times(drive, begin, end):
    first = drive.times_s[0]
    gap = dataclasses.replace(drive, imu=without(drive.imu, first + begin, first + end))
    (note,) = imu_notes(gap, ImuConfig())
    low, high = max(begin, 0.0), min(end, drive.times_s[-1] - first)
    times = [float(word) for word in note.split("from ")[1].split(" s (")[0].replace(" s to", "").split()]
    assert np.allclose(times, [first + low, first + high], atol=0.03)


def test_frames_without_objects_are_said_with_their_numbers(drive, seen):
    kept = tuple(d for d in seen.detections if not 2 <= d.frame <= 13)
    (note,) = object_notes(drive, dataclasses.replace(seen, detections=kept))
    assert "frames 2 to 13" in note
    (note,) = object_notes(drive, dataclasses.replace(seen, detections=()))
    assert "in any frame" in note


def test_a_scale_that_follows_from_sizes_alone_is_said(drive):
    images_alone = dataclasses.replace(drive, imu=None, height_above_ground_m=None)
    (note,) = scale_notes(images_alone)
    assert "height_above_ground_m in a camera.yaml" in note
    assert scale_notes(dataclasses.replace(images_alone, height_above_ground_m=1.65)) == []


def test_objects_that_may_face_the_other_way_are_named_with_the_probability():
    undecided, contrary = "detections do not decide", "detections say so, its masks and key points do not"
    assert heading_notes({1: 0.02, 7: 0.41, 9: 0.93, 3: 0.12}) == [
        f"object {number}: front and rear may be exchanged (probability {p}): the viewing angles of its {why}"
        for number, p, why in ((3, "0.12", undecided), (7, "0.41", undecided), (9, "0.93", contrary))
    ]
