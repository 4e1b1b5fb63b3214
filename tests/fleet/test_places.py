"""Where results go: folders, URLs, and run directories that are carried."""

import json

import pytest

from meshslam.errors import ConfigError, MapError, SequenceError
from meshslam.files import LOCK
from meshslam.fleet.carried import changes_of, files_of, put_files
from meshslam.fleet.places import Folder, Url, in_order
from meshslam.fleet.running import place_of
from meshslam.fleet.urls import downloaded, file_system

pytest.importorskip("fsspec")
RUN = {"config.yaml": b"a", "objects/1.ply": b"b", "manifest.json": b'{"complete": true, "files": ["config.yaml"]}'}


@pytest.fixture(params=["folder", "memory", "file"])
def place(request, tmp_path):
    return {
        "folder": Folder(tmp_path / "out", is_shared=False),
        "memory": Url(f"memory://{tmp_path.name}/out/"),
        "file": Url(f"file://{tmp_path}/out"),
    }[request.param]


def test_what_is_written_is_read(place):
    assert place.read("a") == {}
    place.write("a", RUN)
    assert place.read("a") == RUN
    place.write("a", {"objects/1.ply": None, "map.json": b"c"})
    assert place.read("a") == {"config.yaml": b"a", "manifest.json": RUN["manifest.json"], "map.json": b"c"}
    place.save("fleet.json", b"{}")
    assert not place.is_shared


def test_the_manifest_says_complete_last_and_not_while_others_change():
    order = in_order({**RUN, "gone": None})
    assert [name for name, _ in order] == ["manifest.json", "config.yaml", "gone", "objects/1.ply", "manifest.json"]
    assert json.loads(order[0][1])["complete"] is False
    assert order[-1][1] == RUN["manifest.json"]
    assert in_order({"manifest.json": None, "a": b""})[0] == ("manifest.json", None)


def test_changes_of_a_run_directory(tmp_path):
    put_files(tmp_path, RUN)
    (tmp_path / LOCK).write_text("held")
    (tmp_path / ".map.json.3.meshslam-part").write_text("half")
    assert files_of(tmp_path) == RUN
    assert changes_of(tmp_path, RUN) == {}
    (tmp_path / "config.yaml").write_text("other")
    (tmp_path / "objects" / "1.ply").unlink()
    assert changes_of(tmp_path, RUN) == {"config.yaml": b"other", "objects/1.ply": None}


def test_a_place_by_its_name(tmp_path):
    assert place_of("s3://maps/a", shared=True) == Url("s3://maps/a")
    assert place_of(str(tmp_path), shared=True) == Folder(tmp_path)
    assert not place_of(str(tmp_path), shared=False).is_shared


def test_a_place_that_takes_nothing_is_an_error(tmp_path):
    (tmp_path / "out").write_text("a file")
    with pytest.raises(MapError, match="cannot be written"):
        Url(f"file://{tmp_path}/out").save("fleet.json", b"")


def test_a_url_is_downloaded_to_the_same_path_each_time_and_goes(tmp_path):
    (tmp_path / "drive" / "images").mkdir(parents=True)
    (tmp_path / "drive" / "images" / "0.png").write_text("image")
    (tmp_path / "drive" / "camera.yaml").write_text("camera")
    places = []
    for _ in range(2):
        with downloaded(f"file://{tmp_path}/drive", "a") as here:
            places.append(here)
            assert {p.relative_to(here).as_posix() for p in here.rglob("*.*")} == {"camera.yaml", "images/0.png"}
        assert not here.exists()
    assert places[0] == places[1]
    assert places[0].name == "drive"
    with downloaded(f"file://{tmp_path}/drive/camera.yaml", "a") as here:
        assert here.read_text() == "camera"


def test_urls_that_cannot_be_read_are_errors(tmp_path):
    with pytest.raises(SequenceError, match="no such folder or file"), downloaded(f"file://{tmp_path}/none", "a"):
        pass
    with pytest.raises(ConfigError, match="nosuch://a: cannot be opened"):
        file_system("nosuch://a")
