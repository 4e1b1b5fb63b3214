"""Digests tell contents apart, and nothing else."""

from dataclasses import dataclass

import numpy as np
import pytest

from meshslam.files import digest_of, digest_of_file


@dataclass(frozen=True)
class Box:
    size: object
    name: str = "box"


ALIKE = [
    ([1, 2], [12]),
    (["a", "b"], ["ab"]),
    ([["a"], "b"], ["a", ["b"]]),
    (1, 1.0),
    ("1", 1),
    (None, "None"),
    (np.zeros((2, 3)), np.zeros((3, 2))),
    (np.zeros(2), np.zeros(2, np.float32)),
    ({"a": 1}, {"a": 2}),
    ({"a": 1}, {"b": 1}),
    (Box(1), Box(2)),
    (Box(None), Box((None,))),
    (np.array([1.0]), np.array([np.nextafter(1.0, 2.0)])),
]


@pytest.mark.parametrize(("one", "other"), ALIKE, ids=range(len(ALIKE)))
def test_values_that_differ_have_other_digests(one, other):
    assert digest_of(one) != digest_of(other)
    assert digest_of([one, other]) != digest_of([other, one])


def test_equal_values_have_one_digest():
    assert digest_of({"a": 1, "b": Box(np.arange(3))}) == digest_of({"b": Box(np.arange(3)), "a": 1})
    rows = np.arange(12).reshape(3, 4)
    assert digest_of(rows.T) == digest_of(np.ascontiguousarray(rows.T))


def test_a_file_is_known_by_its_content_alone(tmp_path):
    content = bytes(range(256)) * 9000
    for name, data in (("a", content), ("b", content), ("c", content[:-1] + b"x")):
        (tmp_path / name).write_bytes(data)
    found = [digest_of_file(tmp_path / name) for name in "abc"]
    assert found[0] == found[1] != found[2]
