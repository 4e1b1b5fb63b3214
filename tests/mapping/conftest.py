"""The street of these tests."""

from tests.fixtures.parked_street import (
    as_set,
    box_detection,
    camera,
    car,
    car_detection,
    drive,
    frames,
    only,
    street,
    tracked,
)

__all__ = [
    "as_set",
    "box_detection",
    "camera",
    "car",
    "car_detection",
    "drive",
    "frames",
    "only",
    "street",
    "tracked",
]
