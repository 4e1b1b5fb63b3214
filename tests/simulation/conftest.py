import pytest

from meshslam.categories import load_category
from meshslam.simulation import StreetConfig, make_street, procedural_bodies

SMALL = StreetConfig(frames=4, width_px=400, height_px=120, focal_px=235.0, cars_each_side=2, speed_m_s=20.0)


@pytest.fixture(scope="session")
def car():
    return load_category("car")


@pytest.fixture(scope="session")
def street():
    return make_street(procedural_bodies(3, 5), 3, SMALL)
