"""What a factor belongs to."""

from __future__ import annotations

from dataclasses import dataclass

from meshslam.localization.factors import SeenObject


@dataclass(frozen=True, eq=False)
class ViewTag:
    """A factor that is a view: of which object, in which frame."""

    number: int
    frame: int
    seen: SeenObject


@dataclass(frozen=True)
class PointTag:
    """A factor of the corners of a block of frames."""

    row: int
    first: int


@dataclass(frozen=True)
class RoadTag:
    """A factor that puts an object's wheels on the road."""

    number: int
