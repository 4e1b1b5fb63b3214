"""Tracks that did not become objects."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LeftOut:
    """A track that did not become an object, and why."""

    track: int
    reason: str
    detail: str = ""
