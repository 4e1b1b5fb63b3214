"""The street of these tests."""

from tests.fixtures.imu_street import drive, scene, seen, street

__all__ = ["drive", "scene", "seen", "street"]
