"""Worlds that are known exactly, and recordings of them."""

from meshslam.simulation.bodies import Body, BodySource, procedural_bodies, procedural_body, shapes_of
from meshslam.simulation.config import SimulationConfig, make_world, simulate_street
from meshslam.simulation.fronts import Wall
from meshslam.simulation.motion import ImuNoise, simulated_imu
from meshslam.simulation.recorded import PathFiles, recorded_street
from meshslam.simulation.recording import EXACT, ObserverConfig, observe, write_recording
from meshslam.simulation.render import render_image
from meshslam.simulation.street import Car, Street, StreetConfig, driven_again, make_street

__all__ = [
    "EXACT",
    "Body",
    "BodySource",
    "Car",
    "ImuNoise",
    "ObserverConfig",
    "PathFiles",
    "SimulationConfig",
    "Street",
    "StreetConfig",
    "Wall",
    "driven_again",
    "make_street",
    "make_world",
    "observe",
    "procedural_bodies",
    "procedural_body",
    "recorded_street",
    "render_image",
    "shapes_of",
    "simulate_street",
    "simulated_imu",
    "write_recording",
]
