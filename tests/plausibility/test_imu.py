"""An IMU's usual mistakes are named, and a right one is left alone."""

from dataclasses import replace

import numpy as np
import pytest

from meshslam.plausibility import clean_imu, errors, judge_imu
from meshslam.sequences import ImuSamples
from meshslam.sequences.imu_files import read_imu
from meshslam.sequences.report import Report


@pytest.fixture(scope="module")
def ride():
    """Half a minute on a road: the sensor pitches and rolls by a degree or two, and shakes."""
    rng, times = np.random.default_rng(3), np.arange(0, 30, 0.01)
    tilt = np.array([0.02 * np.sin(1.7 * times), 0.03 * np.sin(1.1 * times + 1), 0.1 * np.sin(0.2 * times)]).T
    rates = np.gradient(tilt, times, axis=0)
    up = np.column_stack([-np.sin(tilt[:, 1]), np.sin(tilt[:, 0]), np.ones(len(times))])
    forces = 9.81 * up / np.linalg.norm(up, axis=1, keepdims=True)
    return ImuSamples(times, rates + rng.normal(0, 2e-3, rates.shape), forces + rng.normal(0, 0.2, forces.shape))


def codes(imu):
    return [finding.code for finding in judge_imu(imu, "imu.csv")]


def test_a_right_one_raises_nothing(ride):
    found = clean_imu(ride, "imu.csv")
    assert found.findings == ()
    assert found.samples is ride


@pytest.mark.data
@pytest.mark.parametrize("name", ["06", "07"])
def test_real_ones_raise_nothing(data_folder, name):
    imu = read_imu(data_folder / "kitti_odometry" / "imu" / f"{name}.csv", Report())
    for first in range(0, len(imu.times_s), 700):  # in stretches of 7 s, as short drives are
        part = slice(first, first + 700)
        cut = ImuSamples(imu.times_s[part], imu.angular_rate_rad_s[part], imu.specific_force_m_s2[part])
        assert clean_imu(cut, name).findings == ()


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda m: replace(m, specific_force_m_s2=m.specific_force_m_s2 / 9.80665), "imu_in_g"),
        (lambda m: replace(m, angular_rate_rad_s=np.degrees(m.angular_rate_rad_s)), "imu_in_degrees"),
        (lambda m: replace(m, specific_force_m_s2=m.specific_force_m_s2 - [0, 0, 9.81]), "imu_without_gravity"),
        (lambda m: ImuSamples(m.times_s, m.specific_force_m_s2, m.angular_rate_rad_s), "imu_columns"),
        (lambda m: replace(m, specific_force_m_s2=3.28084 * m.specific_force_m_s2), "imu_force"),
        (lambda m: replace(m, times_s=1e3 * m.times_s), "times_unit"),
        (lambda m: replace(m, times_s=1e9 * m.times_s), "times_unit"),
    ],
)
def test_each_mistake_is_named(ride, change, code):
    assert codes(change(ride)) == [code]


def test_real_rates_in_degrees_are_named(data_folder):
    imu = read_imu(data_folder / "kitti_odometry" / "imu" / "07.csv", Report())
    assert codes(replace(imu, angular_rate_rad_s=np.degrees(imu.angular_rate_rad_s))) == ["imu_in_degrees"]


def test_wild_and_frozen_samples_are_left_out_and_said(ride):
    forces, rates = ride.specific_force_m_s2.copy(), ride.angular_rate_rad_s.copy()
    forces[100] = -32768.0
    forces[500:560], rates[500:560] = 0.0, 0.0
    forces[900:910], rates[900:910] = forces[900], rates[900]
    found = clean_imu(ImuSamples(ride.times_s, rates, forces), "imu.csv")
    assert [f.code for f in found.findings] == ["wild_samples", "frozen_samples"]
    assert not errors(found.findings)
    gone = np.setdiff1d(np.arange(len(ride.times_s)), np.searchsorted(ride.times_s, found.samples.times_s))
    assert gone.tolist() == [100, *range(500, 560), *range(901, 910)]


def test_an_imu_that_was_never_on_is_an_error(ride):
    dead = replace(
        ride, angular_rate_rad_s=0 * ride.angular_rate_rad_s, specific_force_m_s2=0 * ride.specific_force_m_s2
    )
    assert [f.code for f in errors(clean_imu(dead, "imu.csv").findings)] == ["imu_dead"]
