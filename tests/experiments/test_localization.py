from dataclasses import replace

import pytest

from meshslam.experiments.localization import STREET, localization_experiment
from meshslam.initialization import EstimationConfig
from meshslam.localization import LocalizationConfig
from meshslam.simulation import ImuNoise, SimulationConfig

SMALL = replace(STREET, frames=12, width_px=560, height_px=170, focal_px=330.0, cars_each_side=2)
ROUGH = ImuNoise(accelerometer_bias_m_s2=0.08)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    simulation = SimulationConfig(seed=2, street=SMALL, imu_noise=ROUGH, known_poses=False)
    folder = tmp_path_factory.mktemp("localization") / "sequence"
    return localization_experiment(simulation, EstimationConfig(), LocalizationConfig(), folder, lambda *_: None)


def test_both_solvers_undercut_the_imu_and_the_default_the_papers(found):
    inertial, paper, default = (found.summary[f"ate_{name}_rmse_m"] for name in ("initial", "paper", "default"))
    assert default < 0.02
    assert default < paper < 0.5 * inertial


def test_the_papers_solver_gets_better_with_iterations(found):
    ate = {row["iterations"]: row["ate_rmse_m"] for row in found.rows if row["solver"] == "paper's"}
    assert ate[0] == pytest.approx(found.summary["ate_initial_rmse_m"], rel=0.05)  # none: the IMU alone
    assert ate[20] < 0.7 * ate[1] < ate[0]
    assert {row["solver"] for row in found.rows} == {"paper's", "default"}


def test_pictures_show_path_error_iterations_and_a_frame(found):
    names = {picture.name for picture in found.pictures}
    assert names == {f"{n}.{k}" for n in ("path", "error", "iterations") for k in ("svg", "png")} | {"frame.png"}
    ours = {claim.what: claim.ours for claim in found.claims}
    assert ours["known cars"] == 4
    assert ours["frames"] == 12
