"""What a factor belongs to."""

from __future__ import annotations

from dataclasses import dataclass

from meshslam.graph.object_factor import ObservationCost

DISPLACEMENT = "displacement"  # tag of factors of the distance between two cameras


@dataclass(frozen=True, eq=False)
class ObservationTag:
    """A factor that is an observation: of which object, in which frame."""

    number: int
    frame: int
    cost: ObservationCost


@dataclass(frozen=True)
class PointTag:
    """A factor of point tracks."""

    row: int
    first: int


@dataclass(frozen=True)
class RoadTag:
    """A factor that puts an object's wheels on the road."""

    number: int
