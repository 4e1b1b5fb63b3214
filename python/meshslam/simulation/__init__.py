"""Worlds that are known exactly, and recordings of them."""

from meshslam.simulation.recording import ObserverConfig, observe, write_recording
from meshslam.simulation.render import render_image
from meshslam.simulation.street import Car, Street, StreetConfig, Wall, make_street

__all__ = [
    "Car",
    "ObserverConfig",
    "Street",
    "StreetConfig",
    "Wall",
    "make_street",
    "observe",
    "render_image",
    "write_recording",
]
