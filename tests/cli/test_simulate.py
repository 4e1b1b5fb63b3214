import hashlib

import pytest
import yaml

from meshslam.sequences import open_sequence
from tests.cli.conftest import done, error_of, estimate, meshslam, score

SMALL = {"width_px": 320, "height_px": 100, "focal_px": 190.0, "cars_each_side": 2, "speed_m_s": 15.0}


def contents(folder):
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


@pytest.fixture(scope="module")
def settings(tmp_path_factory):
    path = tmp_path_factory.mktemp("settings") / "small.yaml"
    path.write_text(yaml.safe_dump({"street": SMALL}))
    return path


@pytest.fixture(scope="module")
def simulated(settings, tmp_path_factory):
    out = tmp_path_factory.mktemp("simulated") / "street"
    done("simulate", out, "--config", settings, "--frames", 6, "--seed", 5, "--noise")
    return out


def test_a_sequence_is_made_again_from_its_own_settings_byte_by_byte(simulated, tmp_path):
    done("simulate", tmp_path / "again", "--config", simulated / "simulation.yaml")
    assert contents(tmp_path / "again") == contents(simulated)
    done("simulate", tmp_path / "other", "--config", simulated / "simulation.yaml", "--seed", 6)
    assert contents(tmp_path / "other") != contents(simulated)


@pytest.mark.data
def test_the_independent_scorer_takes_a_simulated_sequence(simulated, data_folder, tmp_path):
    done("map", simulated, "--out", tmp_path / "run")
    found = score(data_folder, simulated, tmp_path / "run")
    assert found["objects"]["recall"] == 1.0
    assert found["objects"]["voxel_iou_mean_all"] > 0.75
    assert found["trajectory"]["ate_rmse_m"] < 0.02
    assert estimate(tmp_path / "run")


def test_poses_can_be_hidden_and_key_points_left_to_the_network(settings, tmp_path):
    flags = ("--hidden-poses", "--no-keypoints", "--mode", "textureless", "--frames", 2)
    done("simulate", tmp_path / "street", "--config", settings, *flags)
    recording = open_sequence(tmp_path / "street")
    assert recording.world_from_camera is None
    assert (tmp_path / "street" / "groundtruth.tum").exists()
    assert '"keypoints"' not in (tmp_path / "street" / "detections.json").read_text()


def test_what_is_there_stays_unless_it_is_ours_and_to_be_replaced(simulated, settings, tmp_path):
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "dear.txt").write_text("mine")
    assert "letters" in error_of(meshslam("simulate", tmp_path / "letters", "--overwrite"))
    assert "--overwrite" in error_of(meshslam("simulate", simulated))
    assert "--poses" in error_of(meshslam("simulate", tmp_path / "new", "--imu", "imu.csv"))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["letters"]


def test_the_place_where_the_command_runs_is_refused_at_once(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for place in (".", "..", "/", tmp_path):
        assert "the command runs in there" in error_of(meshslam("simulate", place))
    assert not list(tmp_path.iterdir())


def test_detections_made_of_a_fisheyes_images_say_that_they_are_undistorted(tmp_path):
    street = SMALL | {"lens": "equidistant", "field_deg": 150.0, "cars_each_side": 1, "moving_cars": 0}
    (tmp_path / "fisheye.yaml").write_text(yaml.safe_dump({"street": street}))
    flags = ("--config", tmp_path / "fisheye.yaml", "--frames", 1, "--mode", "contrast")
    done("simulate", tmp_path / "street", *flags)
    assert open_sequence(tmp_path / "street").distortion.model == "equidistant"
    done("detect", tmp_path / "street", "--segmenter", "colour", "--out", tmp_path / "seen.json")
    assert '"info": {"undistorted": true}' in (tmp_path / "seen.json").read_text()
    assert "undistorted" not in (tmp_path / "street" / "detections.json").read_text()
