"""A drive beside a car that drives, with its exact truth."""

from tests.fixtures.parked_street import as_set, camera, car, car_detection, drive

__all__ = ["as_set", "camera", "car", "car_detection", "drive"]
