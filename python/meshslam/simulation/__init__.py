"""Worlds that are known exactly, and recordings of them."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.simulation.bodies import (
        Body,
        BodySource,
        procedural_bodies,
        procedural_body,
        shapes_of,
    )
    from meshslam.simulation.body_looks import look_of
    from meshslam.simulation.cars import ProceduralCar, make_cars, make_fleet, meshed_cars
    from meshslam.simulation.config import DEMO, SimulationConfig, make_world, simulate_street
    from meshslam.simulation.fronts import Wall
    from meshslam.simulation.light import Light, draw_light, lit, shaded
    from meshslam.simulation.materials import surface
    from meshslam.simulation.motion import ImuNoise, simulated_imu
    from meshslam.simulation.recorded import PathFiles, recorded_street
    from meshslam.simulation.recording import EXACT, ObserverConfig, observe, write_recording, write_truth
    from meshslam.simulation.render import render_image
    from meshslam.simulation.road import Road
    from meshslam.simulation.street import Car, Street, StreetConfig, driven_again, make_street
else:
    __getattr__ = deferred(
        __name__,
        {
            "bodies": "Body BodySource procedural_bodies procedural_body shapes_of",
            "body_looks": "look_of",
            "cars": "ProceduralCar make_cars make_fleet meshed_cars",
            "config": "DEMO SimulationConfig make_world simulate_street",
            "fronts": "Wall",
            "light": "Light draw_light lit shaded",
            "materials": "surface",
            "motion": "ImuNoise simulated_imu",
            "recorded": "PathFiles recorded_street",
            "recording": "EXACT ObserverConfig observe write_recording write_truth",
            "render": "render_image",
            "road": "Road",
            "street": "Car Street StreetConfig driven_again make_street",
        },
    )

__all__ = [
    "DEMO",
    "EXACT",
    "Body",
    "BodySource",
    "Car",
    "ImuNoise",
    "Light",
    "ObserverConfig",
    "PathFiles",
    "ProceduralCar",
    "Road",
    "SimulationConfig",
    "Street",
    "StreetConfig",
    "Wall",
    "draw_light",
    "driven_again",
    "lit",
    "look_of",
    "make_cars",
    "make_fleet",
    "make_street",
    "make_world",
    "meshed_cars",
    "observe",
    "procedural_bodies",
    "procedural_body",
    "recorded_street",
    "render_image",
    "shaded",
    "shapes_of",
    "simulate_street",
    "simulated_imu",
    "surface",
    "write_recording",
    "write_truth",
]
