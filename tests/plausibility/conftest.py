"""The street of these tests."""

from tests.fixtures.imu_street import drive as imu_drive
from tests.fixtures.imu_street import street

__all__ = ["imu_drive", "street"]
