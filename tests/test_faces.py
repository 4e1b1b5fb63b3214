"""The check of the rooms' faces finds what it is for."""

import importlib

import pytest

from scripts.check_faces import PACKAGE, faces, problems


def test_this_package_has_no_problem():
    assert list(problems(PACKAGE)) == []


@pytest.fixture
def package(tmp_path):
    for room in ("one", "two"):
        (tmp_path / "meshslam" / room).mkdir(parents=True)
        (tmp_path / "meshslam" / room / "__init__.py").write_text(
            f'from meshslam.{room}.made import {room}_thing\n\n__all__ = ["{room}_thing"]\n'
        )
        (tmp_path / "meshslam" / room / "made.py").write_text(f"{room}_thing = 1\n")
    return tmp_path / "meshslam"


def test_imports_through_the_face_are_right(package):
    (package / "two" / "user.py").write_text(
        "from meshslam.one import one_thing\nfrom meshslam.two.made import two_thing\n"
    )
    assert list(problems(package)) == []


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("from meshslam.one.made import one_thing", "behind the face of one"),
        ("import meshslam.one.made", "behind the face of one"),
        ("from meshslam.one import other", "other is not in __all__ of one"),
        ("from ..one import one_thing", "relative import"),
    ],
)
def test_what_goes_behind_a_face_is_named(package, line, said):
    (package / "two" / "user.py").write_text(f"def late():\n    {line}\n")
    (found,) = problems(package)
    assert said in found
    assert found.startswith("two/user.py:2")


def test_a_name_that_hides_a_module_is_named(package):
    (package / "one" / "one_thing.py").write_text("")
    (found,) = problems(package)
    assert "one_thing hides the module" in found


def test_every_name_of_every_face_is_there():
    for room, names in faces(PACKAGE).items():
        face = importlib.import_module(f"meshslam.{room}")
        if room not in ("training", "cli"):  # PyTorch is an extra
            assert all(getattr(face, name) is not None for name in names)
        with pytest.raises(AttributeError, match="no_such_name"):
            _ = face.no_such_name


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ('{"made": "one_thing"}', None),
        ('{"other": "one_thing"}', "one_thing comes from meshslam.one.made for type checkers, from meshslam.one.other"),
        ('{"made": "one_thing more"}', "more comes from nowhere for type checkers, from meshslam.one.made"),
        ("{}", "one_thing comes from meshslam.one.made for type checkers, from nowhere"),
    ],
)
def test_a_face_hands_out_what_it_promises(package, names, said):
    (package / "one" / "__init__.py").write_text(
        "if TYPE_CHECKING:\n    from meshslam.one.made import one_thing\n"
        f'else:\n    __getattr__ = deferred(__name__, {names})\n__all__ = ["one_thing"]\n'
    )
    found = list(problems(package))
    assert found == [] if said is None else said in found[0]


def test_a_name_that_is_promised_but_not_listed_is_named(package):
    (package / "one" / "__init__.py").write_text(
        "if TYPE_CHECKING:\n    from meshslam.one.made import one_thing\n"
        'else:\n    __getattr__ = deferred(__name__, {"made": "one_thing"})\n__all__ = []\n'
    )
    assert "one_thing is not in __all__" in " ".join(problems(package))
