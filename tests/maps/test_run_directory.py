import pytest

from meshslam.errors import MapError
from meshslam.maps import RunDirectory
from meshslam.maps.atomic import LEFTOVER_SUFFIX

CONFIG = "tracker: paper\nmodes: 10\n"


@pytest.fixture
def run(tmp_path):
    return RunDirectory.start(tmp_path / "a" / "run", CONFIG, "1.0")


def test_a_run_is_resumed_by_what_is_there(run):
    assert not run.has("detections.json")
    run.save("detections.json", "{}")
    run.save("objects/3.ply", b"mesh")
    again = RunDirectory.start(run.folder, CONFIG, "1.0")
    assert again.has("detections.json")
    assert again.has("objects/3.ply")
    assert not again.has("map.json")
    assert again.path("detections.json").read_text() == "{}"


def test_the_config_can_be_read_back(run):
    import yaml

    assert yaml.safe_load(run.path("config.yaml").read_text()) == {"tracker": "paper", "modes": 10}


@pytest.mark.parametrize(
    ("config", "version", "difference"),
    [
        ("tracker: paper\nmodes: 11\n", "1.0", "there 'modes: 10', now 'modes: 11'"),
        (CONFIG, "1.1", "there 'meshslam run, version 1.0', now 'meshslam run, version 1.1'"),
        (CONFIG + "more: 1\n", "1.0", "there 3 lines, now 4"),
    ],
)
def test_another_configuration_is_refused_or_overwrites(run, config, version, difference):
    run.save("map.json", "old")
    run.save("objects/3.ply", "old")
    (run.folder / "notes.txt").write_text("mine")
    with pytest.raises(MapError) as caught:
        RunDirectory.start(run.folder, config, version)
    assert difference in str(caught.value)
    assert "choose another --out, or --overwrite" in str(caught.value)
    assert run.has("map.json")
    RunDirectory.start(run.folder, config, version, overwrite=True)
    assert sorted(p.name for p in run.folder.iterdir()) == ["config.yaml", "notes.txt"]
    RunDirectory.start(run.folder, config, version)


def test_overwrite_starts_the_same_run_from_nothing(run):
    run.save("map.json", "old")
    assert not RunDirectory.start(run.folder, CONFIG, "1.0", overwrite=True).has("map.json")


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_folder_that_is_no_run_is_left_alone(tmp_path, overwrite):
    (tmp_path / "map.json").write_text("somebody's")
    (tmp_path / "config.yaml").write_text("somebody: else\n")
    with pytest.raises(MapError, match=r"is no run directory but holds config\.yaml, map\.json: choose another --out"):
        RunDirectory.start(tmp_path, CONFIG, "1.0", overwrite=overwrite)
    assert (tmp_path / "map.json").read_text() == "somebody's"


def test_a_start_that_was_killed_before_its_config_is_no_obstacle(tmp_path):
    (tmp_path / f".config.yaml.7{LEFTOVER_SUFFIX}").write_text("half")
    RunDirectory.start(tmp_path, CONFIG, "1.0")
    assert [p.name for p in tmp_path.iterdir()] == ["config.yaml"]


def test_a_file_in_the_way_is_named(tmp_path):
    (tmp_path / "run").write_text("")
    with pytest.raises(MapError, match="run: cannot be used as a run directory"):
        RunDirectory.start(tmp_path / "run", CONFIG, "1.0")
