"""Displacements that the road's texture measures are counted, and each is a factor of the graph."""

from dataclasses import replace

import numpy as np
import pytest

from meshslam.features import RoadConfig
from meshslam.features.image_features import FrameImage
from meshslam.geometry import Camera, Pose
from meshslam.graph import Smoother, SmootherConfig, StartConfig
from meshslam.graph.tags import DISPLACEMENT
from meshslam.motion import ImuConfig, Mounting, NavState, RelativeMotion
from meshslam.object_slam import road_displacements
from meshslam.object_slam.road_displacements import RoadDisplacements

CAMERA = Camera(width=64, height=20, fx=40.0, fy=40.0, cx=31.5, cy=9.0)
STEP_M = 0.8  # two steps are the first that are longer than the baseline of 1 m
CONFIG = RoadConfig(chord_m=3.9, sigma_share=0.05)
PIXEL = FrameImage(np.zeros((1, 1), np.uint8), np.zeros((1, 1), np.uint8))


class Images:
    """One image for all frames."""

    def frame_image(self, _):
        return PIXEL


@pytest.fixture
def measured(monkeypatch):
    """What the road's texture is to say: a function of the two cameras' distance. Returns what it was asked."""

    def says(function):
        asked = []

        def texture(_images, _free, cameras, _normal, height_m, *_):
            assert height_m == 1.6
            asked.append(cameras)
            return function(float(np.linalg.norm(cameras[1].translation - cameras[0].translation)))

        monkeypatch.setattr(road_displacements, "road_displacement_m", texture)
        return asked

    return says


def drive(frames, road):
    """A camera that goes straight ahead, by odometry that is uncertain of its steps by a tenth."""
    smoother = Smoother(ImuConfig(), StartConfig(), SmootherConfig(lag_s=100.0), Mounting(Pose.identity()))
    state, zero = NavState(0.0, Pose.identity(), np.zeros(3), np.zeros(3), np.zeros(3)), np.zeros(3)
    smoother.begin(state, zero)
    step = Pose(np.eye(3), np.array([STEP_M, 0.0, 0.0]))
    for k in range(1, frames):
        state = replace(state, time_s=0.1 * k, world_from_imu=state.world_from_imu @ step)
        smoother.advance(state, RelativeMotion(step, np.array([0.08] * 3 + [1e-3] * 3), zero))
        smoother.solve()
        road.step(smoother, Images())
    return smoother


def displacements(smoother):
    return [e for e in smoother.window.entries if e.tag == DISPLACEMENT]


def test_every_displacement_that_is_found_is_counted_and_is_a_factor(measured):
    asked, road = measured(lambda expected_m: 1.01 * expected_m), RoadDisplacements(CAMERA, 1.6, CONFIG)
    smoother = drive(14, road)
    assert road.count == len(displacements(smoother)) == len(asked) - 2 > 3  # the first two are not confirmed yet
    keys = {entry.keys for entry in displacements(smoother)}
    assert len(keys) == road.count  # each between two other frames
    assert all(np.linalg.norm(b.translation - a.translation) >= CONFIG.min_baseline_m for a, b in asked)


@pytest.mark.parametrize(("every", "is_used"), [(4, False), (3, False), (1, True)])
def test_a_displacement_that_few_frames_about_it_show_is_chance(measured, every, is_used):
    frame = iter(range(100))
    measured(lambda expected_m: 1.1 * expected_m if next(frame) % every == 0 else None)
    road = RoadDisplacements(CAMERA, 1.6, CONFIG)
    smoother = drive(20, road)
    assert (road.count > 0) == is_used
    assert len(displacements(smoother)) == road.count


def test_what_the_texture_does_not_tell_is_neither_counted_nor_a_factor(measured):
    asked, road = measured(lambda _: None), RoadDisplacements(CAMERA, 1.6, CONFIG)
    smoother = drive(12, road)
    assert asked
    assert road.count == 0
    assert displacements(smoother) == []


def test_a_frame_is_measured_once_the_camera_has_driven_over_its_road_and_only_once(measured):
    asked, road = measured(lambda expected_m: expected_m), RoadDisplacements(CAMERA, 1.6, CONFIG)
    drive(6, road)  # 3.9 m of path lie before frame 0 alone
    assert asked == []
    road = RoadDisplacements(CAMERA, 1.6, CONFIG)
    drive(12, road)
    seconds = [b.translation[0] for _, b in asked]
    assert seconds == pytest.approx([STEP_M * k for k in range(2, 7)], abs=0.05)
    assert road.next_frame == 7


@pytest.mark.parametrize("share", [0.95, 1.06])
def test_the_path_is_drawn_to_the_length_that_the_road_says(measured, share):
    measured(lambda _: share * 2 * STEP_M)
    smoother = drive(16, RoadDisplacements(CAMERA, 1.6, replace(CONFIG, sigma_share=0.002)))
    smoother.window.optimize(10)
    places = np.array([smoother.estimate(f).world_from_camera.translation for f in range(11)])
    both = np.linalg.norm(places[2:] - places[:-2], axis=1)[2:]
    assert both[:7] == pytest.approx(share * 2 * STEP_M, rel=0.01)
