"""Worlds that are known exactly, and recordings of them."""

from meshslam.simulation.bodies import Body, BodySource, procedural_bodies, procedural_body, shapes_of
from meshslam.simulation.motion import ImuNoise, simulated_imu
from meshslam.simulation.recorded import PathFiles, recorded_street
from meshslam.simulation.recording import EXACT, ObserverConfig, observe, write_recording
from meshslam.simulation.render import render_image
from meshslam.simulation.street import Car, Street, StreetConfig, Wall, make_street

__all__ = [
    "EXACT",
    "Body",
    "BodySource",
    "Car",
    "ImuNoise",
    "ObserverConfig",
    "PathFiles",
    "Street",
    "StreetConfig",
    "Wall",
    "make_street",
    "observe",
    "procedural_bodies",
    "procedural_body",
    "recorded_street",
    "render_image",
    "shapes_of",
    "simulated_imu",
    "write_recording",
]
