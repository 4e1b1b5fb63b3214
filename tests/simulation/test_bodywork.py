"""What vans, trucks and buses look like: panes, doors, lamps."""

from dataclasses import replace

import numpy as np
import pytest

from meshslam.categories import draw_bus, draw_car, draw_truck, draw_van
from meshslam.categories.procedural.solid import cast, distance_and_normal
from meshslam.simulation import look_of, make_fleet, surface
from meshslam.simulation.look import draw_look


@pytest.fixture(params=range(5))
def van(request):
    rng = np.random.default_rng(request.param)
    shape = draw_van(rng)
    return shape, look_of(rng, shape, "van")


def painted(shape, look, points):
    _, normals = distance_and_normal(shape.field, points)
    return surface(shape, look, points, normals)


def at_the_rear(shape, y, z):
    """Points (n, 3) of the rear end at y, z."""
    inside = np.column_stack([np.full(len(y), shape.rear + 1.0), y, z])
    return cast(shape.field, inside, np.tile([-1.0, 0, 0], (len(y), 1)))


def at_the_side(shape, x, z):
    """Points (n, 3) of the left side at x, z."""
    inside = np.column_stack([x, 0 * x, z])
    return cast(shape.field, inside, np.tile([0, 1.0, 0], (len(x), 1)))


def with_bodywork(look, **changes):
    return replace(look, bodywork=replace(look.bodywork, **changes))


def test_tail_lamps_are_as_high_as_their_key_points(van):
    shape, look = van
    left = shape.keypoints()[10]
    z = np.linspace(0.4, shape.height - 0.3, 80)
    look = with_bodywork(look, adverts=np.zeros((0, 8)), lamp_bands=(0, 0), brake_lamp=0.0)
    look = replace(look, tail_colour=np.array([0, 0, 0.9]), paint=np.full(3, 0.5), reflectors=False, badge=False)
    look = replace(look, plate_colour=np.full(3, 0.8))
    points = at_the_rear(shape, np.full(80, look.bodywork.lamp_out * shape.width / 2 - 0.02), z)
    red = np.ptp(painted(shape, look, points).colour, axis=1) > 0.5
    assert red.any()
    assert z[red].mean() == pytest.approx(left[2], abs=0.1)


@pytest.mark.parametrize("glazed", [False, True])
def test_rear_doors_have_windows_or_none(van, glazed):
    shape, look = van
    body = look.bodywork
    z = np.linspace(body.rear_sill + 0.04, body.rear_top - 0.04, 20)
    points = at_the_rear(shape, np.full(20, 0.35 * shape.width / 2), z)
    found = painted(shape, with_bodywork(look, rear_glass=glazed), points).glass
    assert found.mean() == pytest.approx(float(glazed), abs=0.25)


def test_a_delivery_van_has_panes_in_its_front_doors_alone_and_a_minibus_all_along(van):
    shape, look = van
    body = look.bodywork
    z = np.full(60, (body.sill + body.glass_top) / 2)
    ahead = np.linspace(look.b_pillar + 0.10, look.b_pillar + 0.35, 60)
    behind = np.linspace(shape.rear + look.c_pillar + 0.1, look.b_pillar - 0.1, 60)
    blind, minibus = with_bodywork(look, panes=(0.0, 0.0)), with_bodywork(look, panes=(9.0, 9.0))
    for looks, share in ((blind, 0.0), (minibus, 0.8)):
        assert painted(shape, looks, at_the_side(shape, ahead, z)).glass.mean() > 0.8
        glass = painted(shape, looks, at_the_side(shape, behind, z)).glass
        assert glass.mean() == pytest.approx(share, abs=0.2)


def test_glass_ends_at_its_key_points(van):
    """Above the windshield's corners a high roof is painted."""
    shape, look = van
    top = shape.height - shape.windshield_top
    z = np.linspace(shape.cowl_height + 0.1, shape.height - 0.02, 60)
    inside = np.column_stack([np.zeros(60), np.zeros(60), z])
    points = cast(shape.field, inside, np.tile([1.0, 0, 0], (60, 1)))
    glass = painted(shape, look, points).glass
    assert glass[z < top - 0.05].mean() > 0.9
    assert not glass[z > top + 0.05].any()


def test_cars_keep_the_looks_they_had():
    rng, other = np.random.default_rng(5), np.random.default_rng(5)
    shape = draw_car(np.random.default_rng(2))
    ours, plain = look_of(rng, shape, "car"), draw_look(other, shape.roof_rear_from_tail < 0.8)
    assert ours.bodywork is None
    assert (ours.paint == plain.paint).all()
    assert rng.random() == other.random()


@pytest.mark.parametrize(("draw", "kind"), [(draw_truck, "truck"), (draw_bus, "bus")])
def test_trucks_and_buses_can_be_painted(draw, kind, rng):
    for _ in range(8):
        shape = draw(rng)
        look = look_of(rng, shape, kind)
        side = at_the_side(shape, np.linspace(shape.rear + 0.6, shape.front - 0.6, 40), np.full(40, 1.7))
        found = painted(shape, look, side)
        assert np.isfinite(found.colour).all()
        assert (found.colour >= 0).all()


def test_a_fleet_is_mostly_vans_and_follows_from_its_seed():
    fleet, again = make_fleet(4, 3), make_fleet(4, 3)
    assert len(fleet) == 3
    assert [car.kind for car in fleet] == [car.kind for car in again]
    assert (fleet[0].vertices == again[0].vertices).all()
    assert len({car.kind for car in fleet}) > 1
