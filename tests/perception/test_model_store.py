import pytest

from meshslam.errors import ModelError
from meshslam.perception import load_segmenter
from meshslam.perception.model_store import add_model, find_model, stored_models
from tests.perception.networks import colour_network


@pytest.fixture(autouse=True)
def store(tmp_path, monkeypatch):
    monkeypatch.setenv("MESHSLAM_MODELS", str(tmp_path / "store"))
    return tmp_path / "store"


@pytest.fixture
def network(tmp_path):
    path = tmp_path / "colour.onnx"
    colour_network(path)
    return path


def test_an_empty_store_says_what_to_get_and_where_it_goes(store):
    assert stored_models() == ()
    with pytest.raises(ModelError, match="models add FILE") as error:
        find_model(None)
    assert str(store) in str(error.value)


def test_what_was_added_is_found_by_name_and_is_the_only_choice(network):
    added = add_model(network, licence="MIT")
    assert stored_models() == (added,)
    assert added.licence == "MIT"
    assert find_model("colour") == find_model(None) == added.path
    assert find_model(str(network)) == network
    assert added.path.read_bytes() == network.read_bytes()


def test_of_two_networks_one_has_to_be_named(network):
    add_model(network)
    add_model(network, name="other")
    with pytest.raises(ModelError, match="colour, other"):
        find_model(None)
    assert find_model("other").stem == "other"


def test_a_changed_file_is_noticed(network):
    model = add_model(network)
    model.path.write_bytes(model.path.read_bytes() + b"x")
    with pytest.raises(ModelError, match="checksum"):
        find_model("colour")


def test_no_two_models_share_a_name_and_no_name_leaves_the_store(network, tmp_path):
    add_model(network)
    other = tmp_path / "more" / "colour.onnx"
    other.parent.mkdir()
    colour_network(other, score=0.5)
    with pytest.raises(ModelError, match="--name"):
        add_model(other)
    with pytest.raises(ModelError, match="name"):
        add_model(other, name="../up")


def test_an_adapter_goes_with_its_network(network, tmp_path):
    (tmp_path / "colour.adapter.yaml").write_text("classes: [van, human]\n")
    beside = add_model(network)
    assert load_segmenter(beside.path).names == ("van", "human")
    (tmp_path / "other.yaml").write_text("classes: [bus, human]\n")
    given = add_model(network, name="other", adapter=tmp_path / "other.yaml")
    assert load_segmenter(given.path).names == ("bus", "human")
    assert {m.name for m in stored_models()} == {"colour", "other"}
    with pytest.raises(ModelError, match=r"nothing\.yaml: cannot be read"):
        add_model(network, name="third", adapter=tmp_path / "nothing.yaml")
    assert not (tmp_path / "store" / "third.onnx").exists()


def test_weights_that_are_no_onnx_come_with_the_way_to_it(tmp_path):
    (tmp_path / "best.pt").write_bytes(b"PK")
    for ask in (lambda: find_model("best.pt"), lambda: add_model(tmp_path / "best.pt")):
        with pytest.raises(ModelError, match=r"yolo export model=best\.pt format=onnx"):
            ask()


def test_a_file_that_is_no_network_is_refused(tmp_path):
    (tmp_path / "x.onnx").write_bytes(b"no network")
    with pytest.raises(ModelError, match="cannot be loaded"):
        add_model(tmp_path / "x.onnx")
