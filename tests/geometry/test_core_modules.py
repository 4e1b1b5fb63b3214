"""The check that modules of the core do not import each other in a circle."""

import importlib.util
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "check_core_modules.py"


@pytest.fixture(scope="module")
def check():
    spec = importlib.util.spec_from_file_location("check_core_modules", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _crate(folder, files):
    for name, code in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(code)
    return folder


def test_the_core_has_no_circle(check):
    assert check.circles(check.SOURCES) == []


@pytest.mark.parametrize(
    "a",
    [
        "use crate::b::Thing;",
        "use crate::{other::X, b::{self, Thing}};",
        "fn f() -> crate::b::Thing { todo!() }",
        "use super::b::Thing;",
    ],
)
def test_a_circle_of_modules_is_named(check, tmp_path, a):
    sources = _crate(tmp_path, {"lib.rs": "mod a; mod b;", "a.rs": a, "b.rs": "use crate::a;", "other.rs": ""})
    (circle,) = check.circles(sources)
    assert circle in (["crate::a", "crate::b", "crate::a"], ["crate::b", "crate::a", "crate::b"])


def test_a_circle_within_a_folder_is_named(check, tmp_path):
    files = {
        "a/mod.rs": "mod b;\npub use b::Thing;",
        "a/b.rs": "use super::{c::X, d::Y};",
        "a/c.rs": "use super::b::Z;",
    }
    (circle,) = check.circles(_crate(tmp_path, {"lib.rs": "mod a;", "a/d.rs": "", **files}))
    assert set(circle) == {"crate::a::b", "crate::a::c"}


def test_comments_visibility_and_tests_import_nothing(check, tmp_path):
    b = '// use crate::a;\npub(crate) fn f() { "crate::a"; }\n#[cfg(test)]\nmod tests { use crate::a; }'
    assert check.circles(_crate(tmp_path, {"lib.rs": "", "a.rs": "use crate::b;", "b.rs": b})) == []
