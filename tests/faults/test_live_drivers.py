"""What live drivers send in every frame of a drive: right to centimetres, or an error that names frame and cure."""

import numpy as np
import pytest

from meshslam.errors import DetectionError, SequenceError
from meshslam.localization import Localizer
from meshslam.object_slam import Slam, SlamConfig
from meshslam.runs import Config
from meshslam.sequences import ImuSamples
from tests.faults.disturbances import BRIDGED, fewer_keypoints, resized
from tests.fixtures.imu_street import errors_m, stream

pytestmark = pytest.mark.xdist_group("live drivers")
FRAMES = 12


@pytest.fixture(params=["slam", "localizer"])
def run(request, drive, seen, scene):
    names = {c.name: c.keypoints for c in seen.categories}
    told = {"imu_from_camera": drive.imu_from_camera, "start": drive.initial_state}
    if request.param == "localizer":
        return Localizer(drive.camera, scene, keypoint_names=names, **told)
    config = Config(slam=SlamConfig(min_baseline_m=2.0))
    return Slam(drive.camera, keypoint_names=names["car"], height_above_ground_m=1.65, config=config, **told)


def fed(run, drive, seen, change):
    items = list(stream(drive, seen))[:FRAMES]
    return [run.process(**change(item)).world_from_camera for item in items]


@pytest.mark.parametrize("what", ["each sample twice", "samples in reverse"])
def test_samples_are_sorted_and_counted_once(run, drive, seen, street, what):
    path = fed(run, drive, seen, BRIDGED[what])
    assert errors_m(path, street.world_from_camera[:FRAMES]).max() < 0.1


def late(drive):
    def change(item):
        t, times = item["time_s"], drive.imu.times_s
        keep = (times > t - 0.25) & (times <= t - 0.15)
        return item | {"imu": ImuSamples(*(a[keep] for a in _arrays(drive.imu)))}

    return change


def _arrays(imu):
    return imu.times_s, imu.angular_rate_rad_s, imu.specific_force_m_s2


def test_samples_that_come_after_their_frame_are_said(run, drive, seen):
    with pytest.raises(SequenceError, match=r"frame \d+: its \d+ IMU samples are .*before the last frame .*too late"):
        fed(run, drive, seen, late(drive))


def test_stamps_in_nanoseconds_are_said(run, drive, seen):
    with pytest.raises(SequenceError, match=r"frame 1: .* another unit"):
        fed(run, drive, seen, lambda item: item | {"time_s": item["time_s"] * 1e9})


def test_detections_of_a_resized_image_are_said(run, drive, seen):
    with pytest.raises(DetectionError, match=r"frame 0: .*280x90 px, expected the camera's 560x180 px"):
        fed(run, drive, seen, resized)


def test_other_key_points_are_said(run, drive, seen):
    with pytest.raises(DetectionError, match=r"frame 0: .* has 5 key points, expected 12"):
        fed(run, drive, seen, fewer_keypoints)


def test_numbers_of_numpy_are_numbers(run, drive, seen, tmp_path):
    items = list(stream(drive, seen))[:3]
    for item in items:
        run.process(**item | {"time_s": np.float64(item["time_s"]), "frame": np.int64(item["frame"])})
    run.save(tmp_path / "run.npz")
