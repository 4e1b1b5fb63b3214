import numpy as np
import pytest

from meshslam.plausibility import judge_sizes

CAR, BUS = np.array([4.4, 1.8, 1.5]), np.array([11.0, 2.6, 3.2])


def found(scale=1.0, turn=slice(None)):
    return judge_sizes(
        {"objects/1.ply": ("car", scale * CAR[turn]), "objects/2.ply": ("bus", scale * BUS[turn])}, "map"
    )


def test_usual_sizes_are_right():
    assert found() == []
    assert judge_sizes({"a": ("cup", np.array([0.08, 0.08, 0.1]))}, "map") == []
    assert judge_sizes({}, "map") == []


@pytest.mark.parametrize(("scale", "unit"), [(1000, "millimetres"), (100, "centimetres")])
def test_other_units_are_named_with_file_and_size(scale, unit):
    (finding,) = found(scale)
    assert finding.severity == "error"
    assert unit in finding.message
    assert f"objects/1.ply, a car of {4.4 * scale:.4g}" in finding.message


def test_a_car_that_stands_on_end_is_said():
    (finding,) = found(turn=[1, 2, 0])
    assert finding.code == "map_up_axis"
    assert "z up" in finding.message


def test_a_car_that_lies_across_is_said():
    assert found(turn=[1, 0, 2])[0].code == "map_up_axis"
