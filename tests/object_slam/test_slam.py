from dataclasses import replace

import numpy as np
import pytest

from meshslam.errors import MapError, SequenceError
from meshslam.object_slam import Slam, SlamConfig
from meshslam.runs import Config
from tests.fixtures.imu_street import SOON, errors_m, slammed, stream

ROUNDING = 1e-7  # the last bits of linear algebra vary with memory's alignment
QUICK = {"min_baseline_m": 2.0, "lag_s": 0.8}  # so that frames leave the window of a short drive


@pytest.fixture(scope="module")
def told(drive, seen):
    return {
        "imu_from_camera": drive.imu_from_camera,
        "start": drive.initial_state,
        "keypoint_names": seen.keypoint_names("car"),
        "height_above_ground_m": drive.height_above_ground_m,
        "config": Config(slam=SlamConfig(**QUICK)),
    }


@pytest.fixture(scope="module")
def items(drive, seen):
    return list(stream(drive, seen))


def cameras(states):
    return np.array([s.world_from_camera.matrix for s in states])


def path(slam):
    return slam.finish().trajectory.world_from_camera


def test_a_stream_gives_what_the_whole_sequence_gives(drive, seen, told, items):
    slam = Slam(drive.camera, **told)
    states = [slam.process(**item) for item in items]
    whole = slammed(drive, seen, **QUICK)
    assert errors_m([s.world_from_camera for s in states], whole.filtered).max() < 2e-3
    found = slam.finish()
    assert errors_m(found.trajectory.world_from_camera, whole.trajectory.world_from_camera).max() < 2e-3
    assert set(found.map) == set(whole.map)


def test_saved_in_the_middle_it_goes_on_here_and_there_in_the_same_way(drive, told, items, tmp_path):
    never, first = Slam(drive.camera, **told), Slam(drive.camera, **told)
    apart = [never.process(**item) for item in items]
    for item in items[:9]:
        first.process(**item)
    first.save(tmp_path / "run.npz")
    second = Slam.load(tmp_path / "run.npz", drive.camera, **told)
    here = [first.process(**item) for item in items[9:]]
    there = [second.process(**item) for item in items[9:]]
    assert cameras(here) == pytest.approx(cameras(there), abs=ROUNDING)
    for one, other in zip(here, there, strict=True):
        assert one.camera_covariance == pytest.approx(other.camera_covariance, rel=1e-4, abs=1e-12)
    assert first.finish().estimate.to_csv() == second.finish().estimate.to_csv()
    assert [s.objects for s in here] == [s.objects for s in there] == [s.objects for s in apart[9:]]
    assert errors_m(path(first), path(second)).max() < ROUNDING
    assert np.linalg.norm(cameras(here)[:, :3, 3] - cameras(apart[9:])[:, :3, 3], axis=1).max() < 0.02
    assert errors_m(path(first), path(never)).max() < 0.02


def test_the_map_is_there_at_any_moment_with_covariances(drive, told, items, scene):
    slam = Slam(drive.camera, **told)
    assert len(slam.map()) == 0
    for item in items:
        slam.process(**item)
        for number, thing in slam.map().items():
            assert thing.vertices.shape == (642, 3)
            assert np.linalg.eigvalsh(thing.covariance).min() > 0
            assert number in scene
    assert len(slam.map()) >= 2
    assert np.linalg.eigvalsh(slam.camera_covariance()).min() > 0
    for number, thing in slam.map().items():
        true = scene[number].world_from_object.translation
        assert np.linalg.norm(thing.world_from_object.translation - true) < 0.6


def test_looking_at_the_map_changes_nothing(drive, told, items):
    looked, not_looked = Slam(drive.camera, **told), Slam(drive.camera, **told)
    for item in items:
        one, other = looked.process(**item), not_looked.process(**item)
        assert (one.world_from_camera.matrix == other.world_from_camera.matrix).all()
        known, quick = looked.map(), looked.map(covariances=False)
        assert [*known] == [*quick]
        for number in known:
            assert (known[number].vertices_in_world == quick[number].vertices_in_world).all()
            assert quick[number].covariance is None
        looked.camera_covariance()


def test_without_a_start_it_waits_for_the_first_seconds(drive, told, items, street):
    slam = Slam(drive.camera, **told | {"start": None, "config": replace(SOON, slam=told["config"].slam)})
    states = [slam.process(**item) for item in items]
    first = next((i for i, s in enumerate(states) if s.is_started), len(states))
    assert first > 0
    assert not any(s.is_started for s in states[:first])
    steps = (
        np.diff([p.translation for p in path(slam)], axis=0),
        np.diff([p.translation for p in street.world_from_camera], axis=0),
    )
    lengths = [np.linalg.norm(s, axis=1).sum() for s in steps]
    assert lengths[0] == pytest.approx(lengths[1], rel=0.06)


def test_mistakes_are_said(drive, told, items, tmp_path):
    slam = Slam(drive.camera, **told)
    with pytest.raises(SequenceError, match="nothing to save"):
        slam.save(tmp_path / "run.npz")
    slam.process(**items[0])
    with pytest.raises(SequenceError, match="is not after"):
        slam.process(**items[0])
    with pytest.raises(SequenceError, match="the first had none"):
        slam.process(**items[1], image=np.zeros((180, 560, 3), np.uint8))
    (tmp_path / "other.npz").write_bytes(b"no archive")
    with pytest.raises(MapError, match=r"other\.npz"):
        Slam.load(tmp_path / "other.npz", drive.camera, **told)
    with pytest.raises(SequenceError, match="nothing tells how the camera moves"):
        Slam(drive.camera).process(time_s=0.0, detections=())
    with pytest.raises(SequenceError, match="no odometry"):
        Slam(drive.camera, by_odometry=True).process(time_s=0.0, detections=())


def test_every_frame_has_a_covariance_when_it_comes_and_at_the_end(drive, told, items):
    slam = Slam(drive.camera, **told)
    states = [slam.process(**item) for item in items]
    for state in states:
        assert np.linalg.eigvalsh(state.camera_covariance).min() > 0
    assert slam.camera_covariance() == pytest.approx(states[-1].camera_covariance, rel=0.2, abs=1e-6)
    estimate = slam.finish().estimate
    assert estimate.frame_ids == drive.frame_ids
    assert np.linalg.eigvalsh(estimate.covariances).min() > 0
    # what came later tells of the middle, too: no frame is less certain at the end than when it came
    live = np.array([np.sqrt(np.trace(state.camera_covariance[:3, :3])) for state in states])
    assert (estimate.position_sigmas_m < 1.1 * live).all()
    assert estimate.position_sigmas_m[0] < estimate.position_sigmas_m[-1]
    assert np.linalg.norm(estimate.velocity_in_world[0] - drive.initial_state.velocity_in_world) < 0.5


def test_frames_that_show_nothing_are_extrapolated_and_say_so(drive, told, items):
    slam = Slam(drive.camera, **told)
    for item in items[:-4]:
        slam.process(**item)
    for item in items[-4:]:
        slam.process(**(item | {"detections": ()}))
    estimate = slam.finish().estimate
    assert estimate.extrapolated[-4:].all()
    assert estimate.sources[-4:] == ("imu",) * 4
    assert estimate.sources[5] == "images"
    assert not estimate.extrapolated[5]
    assert (np.diff(estimate.position_sigmas_m[-4:]) > 0).all()


def test_without_a_start_the_path_is_relative_to_its_first_camera_where_that_lays_the_world(drive, told, items):
    slam = Slam(drive.camera, **(told | {"start": None, "config": replace(SOON, slam=SlamConfig(**QUICK))}))
    for item in items:
        slam.process(**item)
    known = drive.initial_state.world_from_camera
    own, laid = (
        slam.finish().estimate,
        slam.finish(world_from_first_camera=lambda first: known @ first.inverse()).estimate,
    )
    assert own.position_sigmas_m[0] > 0.001
    assert laid.position_sigmas_m[0] < 1e-6
    assert laid.rotation_sigmas_rad[0] < 1e-6
    assert laid.position_sigmas_m[-1] > 0.001
    assert laid.to_csv()


def test_without_refinement_the_map_is_the_graphs(drive, seen, scene):
    plain, fitted = slammed(drive, seen, refine_map=False), slammed(drive, seen)
    assert len(plain.map) >= 3
    assert any("refine_map is false" in note for note in plain.notes)
    assert plain.trajectory.world_from_camera[-1].matrix == pytest.approx(
        fitted.trajectory.world_from_camera[-1].matrix
    )
    for number, thing in plain.map.items():
        assert np.linalg.norm(thing.world_from_object.translation - scene[number].world_from_object.translation) < 0.6
        assert thing.pose_covariance is not None


def test_a_maps_covariances_carry_the_paths(drive, seen, monkeypatch):
    exact = slammed(drive, seen).map
    monkeypatch.setattr("meshslam.object_slam.slam.with_path_covariances", lambda scene, *_: scene)
    own = slammed(drive, seen).map
    assert len(own) >= 3
    for number, thing in own.items():
        added = exact[number].pose_covariance - thing.pose_covariance
        assert np.linalg.eigvalsh(added).min() > -1e-9
        assert np.trace(added[:3, :3]) > 1e-4
