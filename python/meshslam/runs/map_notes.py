"""What a user should know of a map's objects."""

from __future__ import annotations

from collections.abc import Mapping

_DOUBTFUL = 0.1  # probability that an object faces the other way
_CONTRARY = 0.5


def heading_notes(reversed_probabilities: Mapping[int, float]) -> list[str]:
    """Which objects may face the other way, by object the probability of that."""
    doubtful = {number: p for number, p in reversed_probabilities.items() if p > _DOUBTFUL}
    return [
        f"object {number}: front and rear may be exchanged (probability {p:.2f}): the viewing angles of its "
        + ("detections do not decide" if p < _CONTRARY else "detections say so, its masks and key points do not")
        for number, p in sorted(doubtful.items())
    ]
