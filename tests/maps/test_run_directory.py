import pytest

from meshslam.errors import MapError
from meshslam.files import LEFTOVER_SUFFIX
from meshslam.maps import Map, RunDirectory

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
    assert sorted(p.name for p in run.folder.iterdir()) == ["config.yaml", "manifest.json", "notes.txt"]
    RunDirectory.start(run.folder, config, version)


def test_a_setting_that_differs_is_named_with_all_that_it_stands_under(tmp_path):
    config = "a:\n  enabled: true\nkeypoints:\n  batch: 8\n  net:\n    enabled: {}\nlast: 1\n"
    run = RunDirectory.start(tmp_path / "run", config.format("true"), "1.0")
    run.save("map.json", "old")
    with pytest.raises(MapError, match=r"there 'keypoints\.net\.enabled: true', now 'keypoints\.net\.enabled: false'"):
        RunDirectory.start(tmp_path / "run", config.format("false"), "1.0")


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


def names_in(folder):
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file())


def finished(folder, **options):
    run = RunDirectory.start(folder, CONFIG, "1.0", **options)
    run.save("map.json", "old")
    run.save("path.png", b"old")
    run.save("objects/3.ply", "old")
    run.finish()
    return run


def test_only_a_finished_run_with_all_its_files_is_complete(run):
    run.save("map.json", "{}")
    assert not RunDirectory.start(run.folder, CONFIG, "1.0").is_complete
    run.finish()
    assert RunDirectory.start(run.folder, CONFIG, "1.0").is_complete
    run.path("map.json").unlink()
    assert not RunDirectory.start(run.folder, CONFIG, "1.0").is_complete


def test_another_input_is_refused_by_name(tmp_path):
    finished(tmp_path, inputs={"images": "a", "map": "b"})
    assert RunDirectory.start(tmp_path, CONFIG, "1.0", inputs={"images": "a", "map": "b"}).is_complete
    with pytest.raises(
        MapError, match=r"a run of other input is here \(images\): choose another --out, or --overwrite"
    ):
        RunDirectory.start(tmp_path, CONFIG, "1.0", inputs={"images": "c", "map": "b"})
    with pytest.raises(MapError, match=r"images \(not there now\)"):
        RunDirectory.start(tmp_path, CONFIG, "1.0", inputs={"map": "b"})
    assert not RunDirectory.start(tmp_path, CONFIG, "1.0", inputs={"map": "c"}, overwrite=True).is_complete


def test_another_truth_is_refused(tmp_path):
    RunDirectory.start(tmp_path, CONFIG, "1.0", inputs={"map": "b"}).finish("there")
    again = RunDirectory.start(tmp_path, CONFIG, "1.0", inputs={"map": "b"})
    again.refuse_other_truth("there")
    with pytest.raises(MapError, match="truth"):
        again.refuse_other_truth("another")


def test_an_old_result_stays_until_the_first_file_of_the_new_one(tmp_path):
    finished(tmp_path)
    before = {name: (tmp_path / name).read_bytes() for name in names_in(tmp_path)}
    new = RunDirectory.start(tmp_path, CONFIG + "more: 1\n", "1.0", overwrite=True)
    assert {name: (tmp_path / name).read_bytes() for name in names_in(tmp_path)} == before
    new.save("trajectory.tum", "new")
    assert names_in(tmp_path) == ["config.yaml", "manifest.json", "trajectory.tum"]
    assert not RunDirectory.start(tmp_path, CONFIG + "more: 1\n", "1.0").is_complete


def test_pictures_that_the_new_run_does_not_make_go_and_files_of_others_stay(tmp_path, a_map):
    finished(tmp_path)
    (tmp_path / "objects" / "mine.ply").write_text("mine")
    (tmp_path / "iterations.png").write_text("mine")
    new = RunDirectory.start(tmp_path, CONFIG, "1.0", overwrite=True)
    new.save_map(Map(a_map.objects[1:]))
    new.finish()
    assert names_in(tmp_path) == [
        "config.yaml",
        "iterations.png",
        "manifest.json",
        "map.json",
        "objects/12.ply",
        "objects/7.ply",
        "objects/mine.ply",
    ]


def test_what_a_first_attempt_wrote_and_the_second_did_not_goes(run):
    run.save("path.png", b"")
    again = RunDirectory.start(run.folder, CONFIG, "1.0")
    again.save("map.json", "{}")
    again.finish()
    assert names_in(run.folder) == ["config.yaml", "manifest.json", "map.json"]


def test_a_damaged_manifest_removes_nothing_outside(run, tmp_path):
    (tmp_path / "a" / "letter.txt").write_text("mine")
    run.save("map.json", "{}")
    text = run.path("manifest.json").read_text().replace('"map.json"', '"../letter.txt", "map.json"')
    run.path("manifest.json").write_text(text)
    RunDirectory.start(run.folder, CONFIG, "1.0", overwrite=True)
    assert (tmp_path / "a" / "letter.txt").read_text() == "mine"


def test_a_run_of_an_earlier_version_is_replaced_only_when_told_to(tmp_path, a_map):
    run = RunDirectory.start(tmp_path, CONFIG, "1.0")
    a_map.save(tmp_path)
    for name in ("metrics.json", "report.html", "path.png"):
        (tmp_path / name).write_text("{}")
    with pytest.raises(MapError, match="images: not recorded then"):
        RunDirectory.start(tmp_path, CONFIG, "1.0", inputs={"images": "a"})
    RunDirectory.start(tmp_path, CONFIG, "1.0", inputs={"images": "a"}, overwrite=True).finish()
    assert names_in(run.folder) == ["config.yaml", "manifest.json"]
