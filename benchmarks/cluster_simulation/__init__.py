"""A Ray cluster that is simulated, and the fleet's own driver on it: scheduling and retries are the code that runs."""

from .machines import Machines, Storage
from .simulated_ray import DriverCosts, SimulatedRay
from .simulation import Day, Report, simulate
from .tasks import Drives, Task

__all__ = ["Day", "DriverCosts", "Drives", "Machines", "Report", "SimulatedRay", "Storage", "Task", "simulate"]
