"""A stream survives what drivers and detectors do to it: whatever is raised, the next frame goes on right."""

import contextlib
import copy
import pickle
import time
import zipfile

import numpy as np
import pytest

from meshslam.errors import MapError, MeshslamError, SequenceError
from meshslam.graph import Checkpoint, Smoother
from meshslam.localization import Localizer
from meshslam.object_slam import Slam, SlamConfig, SlamEstimator
from meshslam.runs import Config
from meshslam.sequences import ImuSamples
from tests.faults.disturbances import BRIDGED, REFUSED, FaultInside, InjectedError, disturbed_run, imu
from tests.fixtures.imu_street import stream

pytestmark = pytest.mark.xdist_group("streams with faults")  # their undisturbed runs are made once
ROUNDING_M = 1e-6


@pytest.fixture(scope="module")
def items(drive, seen):
    return list(stream(drive, seen))


@pytest.fixture(scope="module", params=["slam", "localizer"])
def make(request, drive, seen, scene):
    """How a run is made, or loaded from a file, and what it is told."""
    names = {c.name: c.keypoints for c in seen.categories}
    told = {"imu_from_camera": drive.imu_from_camera, "start": drive.initial_state}
    if request.param == "localizer":
        told["keypoint_names"] = names
        return Make(Localizer, (drive.camera, scene), told)
    told |= {"keypoint_names": names["car"], "height_above_ground_m": drive.height_above_ground_m}
    return Make(Slam, (drive.camera,), told | {"config": Config(slam=SlamConfig(min_baseline_m=2.0, lag_s=0.8))})


class Make:
    def __init__(self, kind, given, told):
        self.kind, self.given, self.told = kind, given, told

    def __call__(self, **changes):
        return self.kind(*self.given, **self.told | changes)

    def load(self, path):
        return self.kind.load(path, *self.given, **self.told)


def places(run, items):
    return np.array([run.process(**item).world_from_camera.translation for item in items])


@pytest.fixture(scope="module")
def right(make, items):
    """Where an undisturbed run finds the camera."""
    return places(make(), items)


@pytest.fixture(scope="module")
def begun(make, items):
    """A run in its middle, to be copied."""
    run = make()
    places(run, items[:7])
    return run


@pytest.mark.parametrize("what", sorted(REFUSED))
def test_what_cannot_be_used_is_refused_and_the_frame_can_be_sent_again(make, items, right, what):
    run = make()
    assert places(run, items[:3]) == pytest.approx(right[:3], abs=ROUNDING_M)
    with pytest.raises(MeshslamError) as caught:
        run.process(**REFUSED[what](items[3]))
    assert len(str(caught.value)) <= 300
    assert "\n" not in str(caught.value)
    assert places(run, items[3:6]) == pytest.approx(right[3:6], abs=ROUNDING_M)


@pytest.mark.parametrize("what", sorted(BRIDGED))
def test_what_can_be_bridged_changes_little(make, items, right, what):
    run = make()
    sent = [*items[:3], BRIDGED[what](items[3]), *items[4:8]]
    assert np.linalg.norm(places(run, sent) - right[:8], axis=1).max() < 0.05


@pytest.mark.parametrize("what", ["a sample is NaN", "a sample of 50 g", "a track twice"])
def test_what_is_left_out_is_noted_once(make, items, what):
    run = make()
    places(run, items[:3])
    assert len(run.process(**BRIDGED[what](items[3])).notes) == 1
    assert run.process(**items[4]).notes == ()


@pytest.mark.parametrize("after", [30, 300, 1500, 4000])
def test_a_fault_inside_leaves_no_trace(make, items, right, after):
    run = make()
    places(run, items[:6])
    for item, expected in zip(items[6:10], right[6:10], strict=True):
        fault = FaultInside(after)
        try:
            with fault:
                state = run.process(**item)
        except (MeshslamError, InjectedError):
            assert fault.raised
            state = run.process(**item)
        assert state.world_from_camera.translation == pytest.approx(expected, abs=ROUNDING_M)


def test_a_solver_that_gives_up_after_the_work_leaves_no_trace(make, items, right, monkeypatch):
    run = make()
    places(run, items[:6])
    retire = Smoother.retire

    def failing(self):
        retire(self)
        raise RuntimeError("Indeterminant linear system detected while working near variable x6")

    with monkeypatch.context() as patch:
        patch.setattr(Smoother, "retire", failing)
        for _ in range(2):
            with pytest.raises(SequenceError, match=r"frame 6: RuntimeError: Indeterminant.*as before this call"):
                run.process(**items[6])
    assert places(run, items[6:]) == pytest.approx(right[6:], abs=ROUNDING_M)


def test_what_left_the_window_in_a_call_that_failed_is_back(make, items, monkeypatch):
    run = make()
    if not isinstance(run, Slam):
        pytest.skip("of SLAM, which keeps what leaves")
    places(run, items[:11])
    held = _history(run)
    with monkeypatch.context() as patch:
        patch.setattr(SlamEstimator, "_close_loops", _given_up)
        with pytest.raises(SequenceError, match="gave up"):
            run.process(**items[11])
    assert _history(run) == held
    run.process(**items[11])
    assert _history(run) > held


def _given_up(_):
    raise RuntimeError("gave up")


def _history(run):
    history = run._estimator.smoother.history
    return history.values.size(), len(history.entries)


def test_samples_after_one_far_ahead_are_not_old(make, items):
    run = make()
    places(run, items[:3])
    assert len(run.process(**BRIDGED["a time far ahead"](items[3])).notes) == 1
    newest_s = run._stream.samples().times_s[-1]
    run.process(**items[4])
    assert newest_s < run._stream.samples().times_s[-1] == items[4]["imu"].times_s[-1]


def test_a_key_that_interrupts_leaves_no_trace_and_goes_through(make, items, right, monkeypatch):
    run = make()
    places(run, items[:6])
    with monkeypatch.context() as patch:
        patch.setattr(Smoother, "retire", _interrupted)
        with pytest.raises(KeyboardInterrupt):
            run.process(**items[6])
    assert places(run, items[6:9]) == pytest.approx(right[6:9], abs=ROUNDING_M)


def _interrupted(_):
    raise KeyboardInterrupt


def test_the_first_frame_may_come_without_samples(make, items, right):
    run, (first, second, *rest) = make(), items
    late = second | {"imu": ImuSamples(*(np.concatenate(pair) for pair in zip(_of(first), _of(second), strict=True)))}
    assert not run.process(**first | {"imu": None}).is_started
    assert np.linalg.norm(places(run, [late, *rest[:4]]) - right[1:6], axis=1).max() < 0.05


def _of(item):
    given = item["imu"]
    return given.times_s, given.angular_rate_rad_s, given.specific_force_m_s2


def test_a_stream_without_samples_is_said(make, items):
    run = make()
    run.process(**items[0] | {"imu": None})
    with pytest.raises(SequenceError, match="no IMU samples in the first"):
        run.process(**items[1] | {"time_s": 5.0, "imu": None})


def test_dropped_frames_and_samples_are_bridged(make, items, right):
    run = make()
    places(run, items[:4])
    joint = items[5] | {"imu": ImuSamples(*(np.concatenate(p) for p in zip(_of(items[4]), _of(items[5]), strict=True)))}
    assert np.linalg.norm(places(run, [joint, *items[6:9]]) - right[5:9], axis=1).max() < 0.05
    assert run.process(**items[9] | {"imu": None}).has_imu_gap


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t, w, f: (t, w, f / 9.80665), "it is in g"),
        (lambda t, w, f: (t, f, w), "are swapped"),
        (lambda t, w, f: (t, w, f - [0.0, 0.0, 9.81]), "gravity was taken off"),
    ],
)
def test_an_imu_in_other_units_is_said_after_a_second(make, items, change, said):
    run, last = make(), None
    for item in items:
        try:
            run.process(**imu(item, change))
        except SequenceError as error:
            last = (item["time_s"], str(error))
            break
    assert last is not None
    assert said in last[1]
    assert last[0] - items[0]["time_s"] < 1.3


def test_a_copy_goes_on_and_the_original_as_if_it_had_not_been_copied(make, items, right):
    run = make()
    waiting = copy.deepcopy(run)
    places(run, items[:7])
    one, other = copy.deepcopy(run), pickle.loads(pickle.dumps(run))
    there = places(one, items[7:])
    assert places(other, items[7:]) == pytest.approx(there, abs=ROUNDING_M)
    assert places(run, items[7:]) == pytest.approx(right[7:], abs=ROUNDING_M)
    assert np.linalg.norm(there - right[7:], axis=1).max() < 0.05
    assert places(waiting, items[:3]) == pytest.approx(right[:3], abs=ROUNDING_M)


def test_damaged_files_are_map_errors(make, items, begun, tmp_path):
    begun.save(tmp_path / "run.npz")
    whole = (tmp_path / "run.npz").read_bytes()
    rng = np.random.default_rng(5)
    for cut in (0, 10, len(whole) // 2, len(whole) - 30):
        (tmp_path / "cut.npz").write_bytes(whole[:cut])
        with pytest.raises(MapError, match=r"cut\.npz"):
            make.load(tmp_path / "cut.npz")
    for _ in range(30):
        spoiled = bytearray(whole)
        spoiled[int(rng.integers(len(whole)))] ^= int(rng.integers(1, 256))
        (tmp_path / "spoiled.npz").write_bytes(spoiled)
        with contextlib.suppress(MapError):
            make.load(tmp_path / "spoiled.npz")
    assert make.load(tmp_path / "run.npz").process(**items[7]).is_started


def test_a_file_that_lacks_an_array_or_holds_another_is_a_map_error(make, begun, tmp_path):
    begun.save(tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz") as archive:
        arrays = {name: archive[name] for name in archive.files}
    for name in sorted(arrays)[::4] + ["own", "imu", "format"]:
        rest = {k: v for k, v in arrays.items() if k != name}
        np.savez(tmp_path / "lacks.npz", **rest)
        with pytest.raises(MapError, match=r"lacks\.npz"):
            make.load(tmp_path / "lacks.npz")
        np.savez(tmp_path / "other.npz", **rest | {name: np.array("{}")})
        with pytest.raises(MapError, match=r"other\.npz"):
            make.load(tmp_path / "other.npz")


def test_an_array_that_says_it_is_larger_than_the_file_is_not_unpacked(make, tmp_path):
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("imu.npy", bytes(80 << 20))
    assert (tmp_path / "bomb.npz").stat().st_size < 200_000
    with pytest.raises(MapError, match="says it unpacks to 83886080 bytes"):
        make.load(tmp_path / "bomb.npz")


def test_what_was_loaded_knows_its_first_state(make, begun, tmp_path):
    if not isinstance(begun, Slam):
        pytest.skip("of SLAM")
    begun.save(tmp_path / "run.npz")
    one, other = begun.first_state, make.load(tmp_path / "run.npz").first_state
    assert one.time_s == other.time_s
    assert (one.world_from_imu.matrix == other.world_from_imu.matrix).all()


def test_disturbed_streams_go_on_as_undisturbed_ones(make, items, right):
    for seed in range(3):
        told = list(disturbed_run(make(), items, right, np.random.default_rng(seed)))
        assert [one for one in told if one[1]] == [], f"seed {seed}"


def test_a_checkpoint_costs_little(begun):
    began_s = time.process_time()
    for _ in range(20):
        Checkpoint(begun)
    assert (time.process_time() - began_s) / 20 < 0.02
