"""A record's factor is the one that GTSAM makes of the same measurement."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, E, O, V, X

from meshslam.geometry import Pose, exp_so3
from meshslam.graph.graph_archive import records_from_arrays, records_to_arrays
from meshslam.graph.record_factors import factor_of
from meshslam.graph.records import (
    KINDS,
    Record,
    biases_record,
    imu_record,
    pose_record,
    rotation_record,
    step_record,
    vector_record,
)
from meshslam.motion import ImuConfig, NavState, Preintegrator, RelativeMotion, to_pose3
from meshslam.sequences import ImuSamples

BETWEEN = (X(0), V(0), X(1), V(1), B(0), B(1))


def interval(rng, gap):
    """Noisy samples about an interval, with biases that are not zero."""
    times_s = np.arange(0.0, 0.3, 0.01)
    if gap:
        times_s = times_s[(times_s < 0.1) | (times_s > 0.17)]
    count = len(times_s)
    samples = ImuSamples(times_s, rng.normal(0, 0.3, (count, 3)), rng.normal(0, 1.0, (count, 3)) + [0.0, 0.0, 9.8])
    biases = rng.normal(0, 0.02, (2, 3))
    state = NavState(0.083, Pose.identity(), np.zeros(3), *biases)
    return Preintegrator(ImuConfig()).between(samples, state.time_s, 0.187, state), biases.ravel()


@pytest.mark.parametrize("gap", [False, True], ids=["samples throughout", "a gap"])
def test_the_imus_factor_holds_the_interval_to_the_last_bit(rng, gap):
    made, biases = interval(rng, gap)
    assert made.has_gap == gap
    found = factor_of(imu_record(BETWEEN, made.readings), None).preintegratedMeasurements()
    assert np.array_equal(found.biasHatVector(), biases)
    assert np.array_equal(found.preintMeasCov(), made.measurements.preintMeasCov())
    for name in ("deltaPij", "deltaVij", "deltaTij"):
        assert np.array_equal(getattr(found, name)(), getattr(made.measurements, name)()), name
    assert np.array_equal(found.deltaRij().matrix(), made.measurements.deltaRij().matrix())


def priors(rng):
    """Records, and the factors that they mean."""
    pose, turn = Pose(exp_so3(rng.normal(size=3)), rng.normal(size=3)), exp_so3(rng.normal(size=3))
    sigmas, vector, biases, noise = rng.uniform(0.1, 1, 6), rng.normal(size=3), rng.normal(size=6), gtsam.noiseModel
    yield pose_record(O(1), pose, sigmas), gtsam.PriorFactorPose3(O(1), to_pose3(pose), noise.Diagonal.Sigmas(sigmas))
    yield (
        vector_record(V(1), vector, 0.3),
        gtsam.PriorFactorVector(V(1), vector, noise.Isotropic.Sigma(3, 0.3)),
    )
    bias = gtsam.imuBias.ConstantBias(biases[:3], biases[3:])
    yield biases_record(B(1), biases, sigmas), gtsam.PriorFactorConstantBias(B(1), bias, noise.Diagonal.Sigmas(sigmas))
    yield (
        rotation_record(E(0), turn, 0.2),
        gtsam.PriorFactorRot3(E(0), gtsam.Rot3(turn), noise.Isotropic.Sigma(3, 0.2)),
    )
    ours = RelativeMotion(pose, sigmas, np.zeros(3))
    swapped = noise.Diagonal.Sigmas(sigmas[[3, 4, 5, 0, 1, 2]])
    yield step_record(X(0), X(1), ours), gtsam.BetweenFactorPose3(X(0), X(1), to_pose3(pose), swapped)


def test_priors_and_steps_are_those_of_gtsam(rng):
    for record, meant in priors(rng):
        assert factor_of(record, None).equals(meant, 1e-12), record.kind


def test_records_are_read_back_to_the_last_bit(rng):
    records = [record for record, _ in priors(rng)]
    records += [Record(kind, (X(k), O(k)), rng.normal(size=k)) for k, kind in enumerate(KINDS)]
    read = list(records_from_arrays(records_to_arrays(records)))
    assert [(r.kind, r.keys) for r in read] == [(r.kind, r.keys) for r in records]
    assert all(np.array_equal(one.numbers, other.numbers) for one, other in zip(read, records, strict=True))
    assert list(records_from_arrays(records_to_arrays([]))) == []


def test_numbers_that_are_missing_are_an_error(rng):
    arrays = records_to_arrays([record for record, _ in priors(rng)])
    with pytest.raises(ValueError, match="expected"):
        list(records_from_arrays(arrays | {"numbers": arrays["numbers"][:-1]}))
