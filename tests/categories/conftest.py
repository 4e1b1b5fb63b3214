import pytest

from meshslam.categories import Category, load_category
from meshslam.categories.build import build_car


@pytest.fixture(scope="session")
def car() -> Category:
    return load_category("car")


@pytest.fixture(scope="session")
def small_car() -> Category:
    return build_car(seed=3, count=8, modes=4)
