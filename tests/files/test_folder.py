"""A folder is replaced whole, and what others put there moves along."""

import pytest

from meshslam.errors import SequenceError
from meshslam.files import replaced_folder


def put(folder, *, fail=False, **files):
    with replaced_folder(folder, ("*.txt",), lambda: None, SequenceError) as part:
        for name, text in files.items():
            (part / name).write_text(text)
        if fail:
            raise KeyboardInterrupt


def found(folder):
    return {p.name: p.read_text() for p in folder.iterdir() if not p.name.startswith(".")}


@pytest.fixture
def folder(tmp_path):
    put(tmp_path / "made", a="1", b="1")
    return tmp_path / "made"


def test_the_new_one_takes_the_place_of_the_old(folder):
    put(folder, b="2")
    assert found(folder) == {"b": "2"}
    assert [p.name for p in folder.parent.iterdir()] == ["made"]


def test_what_is_interrupted_leaves_the_old_one(folder):
    with pytest.raises(KeyboardInterrupt):
        put(folder, fail=True, b="2")
    assert found(folder) == {"a": "1", "b": "1"}
    assert [p.name for p in folder.parent.iterdir()] == ["made"]


def test_files_of_others_move_along(folder):
    (folder / "sub").mkdir()
    (folder / "sub" / "mine").write_text("mine")
    put(folder, b="2")
    assert (folder / "sub" / "mine").read_text() == "mine"


def test_a_file_of_others_that_is_in_the_way_is_named(folder):
    (folder / "c").write_text("mine")
    with pytest.raises(SequenceError, match="c: is in the way"):
        put(folder, c="2")
    assert found(folder) == {"a": "1", "b": "1", "c": "mine"}


def test_an_old_one_that_was_moved_away_comes_back(folder):
    folder.rename(folder.with_name(".made.old.meshslam-part"))

    def refused():
        raise SequenceError("no")

    with pytest.raises(SequenceError, match="no"), replaced_folder(folder, (), refused, SequenceError):
        pass
    assert found(folder) == {"a": "1", "b": "1"}


def test_a_folder_of_an_earlier_version_is_known_by_its_names(tmp_path):
    (tmp_path / "made").mkdir()
    (tmp_path / "made" / "old.txt").write_text("")
    (tmp_path / "made" / "mine.doc").write_text("mine")
    put(tmp_path / "made", b="2")
    assert found(tmp_path / "made") == {"b": "2", "mine.doc": "mine"}


def test_a_link_in_a_circle_is_refused_before_the_block_runs(tmp_path):
    loop, worked = tmp_path / "loop", []
    loop.symlink_to("loop")
    with (
        pytest.raises(SequenceError, match="loop: is no folder"),
        replaced_folder(loop, (), lambda: None, SequenceError),
    ):
        worked.append(1)
    assert not worked
    assert loop.is_symlink()
