"""A file read entry by entry says what the whole file says, and what is wrong with it in the same words."""

import json
import tracemalloc

import numpy as np
import pytest

from meshslam.errors import DetectionError
from meshslam.perception.json_document import Entries, load_with_entries
from meshslam.perception.json_values import load_json

SOUND = (
    '{"images": [], "annotations": [{"id": 1}, [2, "]"], null, 3.5e2, "a,b"], "categories": [{}]}',
    ' {\n"annotations" : [ ] , "info":{"annotations": [7]}}\n',
    '{"annotations": {"0": 1}}',
    '{"annotations": [1], "annotations": [2, 3]}',
    '{"annotations": [NaN, -Infinity], "ä": "\\u00e4ö"}',
    '[{"annotations": [1]}]',
    "{}",
    "17",
)
BROKEN = (
    "",
    "{",
    '{"annotations": [1, 2',
    '{"annotations": [1, 2,]}',
    '{"annotations": [1 2]}',
    '{"annotations": [1],}',
    '{"annotations": [1]} x',
    '{"annotations" [1]}',
    "{annotations: [1]}",
    "{3: 4}",
    '{"annotations": [{"id": 1}, {"id": 2, ]}',
    '{"a": ' + "[" * 100_000,
    '{"annotations": [' + "[" * 100_000,
    '{"annotations": [' + "1" * 100_000 + "]}",
)


def plain(value):
    if not isinstance(value, dict):
        return value
    return {name: list(part) if isinstance(part, Entries) else part for name, part in value.items()}


def told(load, path):
    try:
        return repr(plain(load(path)))
    except DetectionError as error:
        return str(error)


def by_entries(path):
    return load_with_entries(path, "annotations")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("text", SOUND)
def test_a_sound_file_is_what_json_says(tmp_path, text, encoding):
    path = tmp_path / "a.json"
    path.write_text(text, encoding=encoding)
    assert told(by_entries, path) == told(load_json, path)


@pytest.mark.parametrize("text", BROKEN, ids=range(len(BROKEN)))
def test_a_broken_file_is_refused_as_by_json(tmp_path, text):
    path = tmp_path / "a.json"
    path.write_text(text)
    assert "no JSON" in told(by_entries, path)
    assert told(by_entries, path) == told(load_json, path)


def test_a_file_with_one_byte_changed_says_the_same(tmp_path):
    rng, path = np.random.default_rng(5), tmp_path / "a.json"
    text = '{"images": [{"id": 1, "n": "a"}], "annotations": [{"id": 1, "s": [2, 3]}, {"id": 2}], "categories": []}'
    for _ in range(200):
        at, byte = int(rng.integers(len(text))), chr(rng.choice(list(b'[]{},:"1 e\\')))
        path.write_text(text[:at] + byte + text[at + 1 :])
        assert told(by_entries, path) == told(load_json, path)


def test_a_missing_file_is_told(tmp_path):
    assert "cannot be read" in told(by_entries, tmp_path / "none.json")


def test_the_entries_are_never_in_memory_together(tmp_path):
    path, count = tmp_path / "a.json", 4_000
    path.write_text(json.dumps({"annotations": [{"id": k, "numbers": [k + 0.5] * 12} for k in range(count)]}))
    held = {}
    for load in (load_json, by_entries):
        tracemalloc.start()
        assert sum(1 for _ in load(path)["annotations"]) == count
        held[load] = tracemalloc.get_traced_memory()[1] - path.stat().st_size
        tracemalloc.stop()
    assert held[by_entries] < 0.3 * held[load_json]
