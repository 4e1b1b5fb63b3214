import cv2
import numpy as np
import pytest

from meshslam.geometry import GroundPlane, ObjectModel, Pose
from meshslam.objects import ObjectConfig
from meshslam.objects.observations import (
    Crop,
    crop_around,
    keypoints_of,
    near_edge,
    signed_distance,
    solid,
    trace_border,
)
from meshslam.objects.track import Track, make_views


def blob(rng, size=40):
    field = cv2.GaussianBlur(rng.standard_normal((size, size)), (0, 0), 3)
    return (field > np.quantile(field, 0.6)).astype(np.uint8)


def disc(centre, radius, size=120):
    x, y = np.meshgrid(np.arange(size), np.arange(size))
    return (np.hypot(x - centre[0], y - centre[1]) < radius).astype(np.uint8)


@pytest.mark.parametrize("seed", range(8))
def test_signed_distance_is_that_to_the_nearest_pixel_of_the_other_kind_less_half_a_pixel(seed):
    mask = blob(np.random.default_rng(seed))
    padded = np.pad(mask, 1)
    places = np.argwhere(padded >= 0)
    expected = np.zeros(padded.shape)
    for y, x in places:
        other = np.argwhere(padded != padded[y, x])
        gap = np.hypot(*(other - [y, x]).T).min() - 0.5
        expected[y, x] = -gap if padded[y, x] else gap
    np.testing.assert_allclose(signed_distance(mask), expected[1:-1, 1:-1], atol=0.01)


def test_signed_distance_has_the_same_bits_wherever_its_pictures_lie():
    rng = np.random.default_rng(1)
    mask, kept, found = disc((57.3, 61.8), 31.0), [], set()
    for _ in range(40):
        kept.append(np.zeros(int(rng.integers(1, 50_000))))  # other memory is free each time
        found.add(signed_distance(mask).tobytes())
    assert len(found) == 1


def test_signed_distance_of_an_empty_mask_is_positive_everywhere():
    assert (signed_distance(np.zeros((20, 30), np.uint8)) > 0).all()


@pytest.mark.parametrize("seed", range(6))
def test_border_points_lie_on_the_border_and_their_lengths_add_up_to_it(seed):
    rng = np.random.default_rng(seed)
    centre, radius = 60 + rng.uniform(-1, 1, 2), rng.uniform(20, 45)
    mask = disc(centre, radius)
    border = trace_border(mask, signed_distance(mask), np.zeros_like(mask), 2.0)
    away = np.hypot(*(border.pixels - centre).T) - radius
    assert np.sqrt((away**2).mean()) < 0.3
    assert abs(away.mean()) < 0.15
    assert border.lengths_px.sum() == pytest.approx(2 * np.pi * radius, rel=0.1)
    assert border.own.all()
    assert not border.cut.any()


def test_border_of_a_half_plane_is_between_its_pixels():
    mask = np.zeros((40, 40), np.uint8)
    mask[:, 15:30] = 1
    border = trace_border(mask, signed_distance(mask), np.zeros_like(mask), 1.0)
    middle = border.pixels[(border.pixels[:, 1] > 5) & (border.pixels[:, 1] < 34)]
    assert np.minimum(np.abs(middle[:, 0] - 14.5), np.abs(middle[:, 0] - 29.5)).max() < 0.05


def test_an_empty_mask_has_no_border():
    border = trace_border(np.zeros((9, 9), np.uint8), np.ones((9, 9)), np.zeros((9, 9), np.uint8), 2.0)
    assert border.pixels.shape == (0, 2)


def test_a_border_at_the_images_edge_is_not_the_objects_own(camera):
    crop = Crop(0, 0, 100, camera.height)
    mask = np.zeros((camera.height, 100), np.uint8)
    mask[50:120, :60] = 1  # cut by the left edge
    border = trace_border(mask, signed_distance(mask), near_edge(crop, camera, 3), 2.0)
    left = border.pixels[:, 0] < 2
    assert left.sum() > 20
    assert not border.own[left].any()
    assert border.own[border.pixels[:, 0] > 4].all()
    assert border.cut[85, 10] == 1  # nearest to the cut
    assert border.cut[85, 55] == 0  # nearest to the object's own border


def test_edges_of_a_crop_within_the_image_are_no_edges(camera):
    assert not near_edge(Crop(50, 60, 40, 30), camera, 3).any()
    assert near_edge(Crop(0, 60, 40, 30), camera, 3)[:, :3].all()


def test_a_border_at_an_occluder_is_not_the_objects_own():
    mask, occluder = disc((60, 60), 40), np.zeros((120, 120), np.uint8)
    occluder[:, 70:] = 1
    mask[:, 70:] = 0
    near = cv2.dilate(occluder, np.ones((7, 7), np.uint8))
    border = trace_border(mask, signed_distance(mask), near, 2.0)
    straight = np.abs(border.pixels[:, 0] - 69.5) < 1
    assert straight.sum() > 20
    assert not border.own[straight].any()
    assert border.own[border.pixels[:, 0] < 60].all()
    assert border.cut[60, 80] == 1
    assert border.cut[60, 5] == 0


def test_solid_fills_holes_drops_specks_and_keeps_parts():
    mask = disc((40, 60), 25)
    whole = mask.copy()
    mask[55:65, 35:45] = 0
    mask[10, 10] = 1
    large = disc((95, 60), 15)
    np.testing.assert_array_equal(solid(mask | large), whole | large)


def test_a_crop_stays_in_the_image_and_holds_the_box(camera, box_detection, rng):
    for _ in range(50):
        x, y = rng.uniform(0, camera.width - 30), rng.uniform(0, camera.height - 20)
        w, h = rng.uniform(5, camera.width - x), rng.uniform(5, camera.height - y)
        crop = crop_around(box_detection(1, 0, (int(x), int(y), int(w), int(h))), camera, 0.5)
        assert 0 <= crop.x0 <= x
        assert 0 <= crop.y0 <= y
        assert camera.width >= crop.x0 + crop.width >= x + w - 1
        assert camera.height >= crop.y0 + crop.height >= y + h - 1


def test_key_points_follow_names_not_order_and_weak_ones_are_left_out(camera, car, car_detection, drive):
    config = ObjectConfig()
    pose = Pose.from_yaw(0.3, np.array([12.0, 2.0, 0.7]))
    detection = car_detection(1, 0, drive(1)[0], pose, car.vertices)
    detection.keypoint_scores[4] = 0.1
    order = [(k + 3) % 12 for k in range(12)]
    order[7] = -1  # a name that the category does not know
    index, pixels, sigma_px = keypoints_of(detection, order, config)
    assert index.tolist() == [order[k] for k in range(12) if k not in (4, 7)]
    np.testing.assert_array_equal(pixels, np.delete(detection.keypoints, [4, 7], axis=0))
    assert (sigma_px >= config.min_keypoint_sigma_px).all()


def test_what_hides_an_object_does_not_pull_it(camera, car, car_detection, drive):
    """A car behind another: told of the other, it is found where it stands; not told, it is pulled."""
    model = ObjectModel(car.vertices, car.faces, car.modes, car.mirror, car.keypoint_weights, car.wheel_vertices)
    config, poses = ObjectConfig(), drive(5)
    true = Pose.from_yaw(0.05, np.array([15.0, 3.0, car.dimensions[2] / 2]))
    before = Pose.from_yaw(0.0, np.array([9.7, 3.4, car.dimensions[2] / 2]))
    seen = [car_detection(i + 1, i, p, true, car.vertices, [(before, car.vertices)]) for i, p in enumerate(poses)]
    other = [car_detection(i + 9, i, p, before, car.vertices).mask() for i, p in enumerate(poses)]
    track = Track(1, tuple(seen), poses, np.arange(5) * 0.1)
    start = model.state_at(Pose.from_yaw(0.0, true.translation + [0.5, -0.3, 0.05]))
    ground = GroundPlane(np.array([0.0, 0.0, 1.0]), 0.0, 0.05, 0.02)
    errors = []
    for told in (True, False):
        views = make_views(track, model, car, [""] * 12, camera, lambda d, t=told: other[d.frame] * np.uint8(t), config)
        found = model.refine(views, ground, config.noise, start, modes=False, free_form=False)
        errors.append(np.linalg.norm(found.state.world_from_object.translation - true.translation))
    assert errors[0] < 0.1
    assert errors[1] > 3 * errors[0]


@pytest.mark.parametrize("angle_deg", [0, 15, 30, 45, 70, 120])
def test_a_straight_border_is_found_where_it_is_however_it_is_turned(angle_deg):
    """Half-planes whose border lies anywhere between the pixels: no direction is drawn too large or too small."""
    rng, size = np.random.default_rng(angle_deg), 81
    normal = np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])
    x, y = np.meshgrid(np.arange(size), np.arange(size))
    beyond = []
    for _ in range(20):
        offset = normal @ [size / 2, size / 2] + rng.uniform(-1, 1)
        mask = (normal[0] * x + normal[1] * y < offset).astype(np.uint8)
        border = trace_border(mask, signed_distance(mask), np.zeros_like(mask), 1.0)
        inside = np.abs(border.pixels - size / 2).max(1) < size / 2 - 6  # not the picture's own edge
        beyond.append((border.pixels[inside] @ normal - offset).mean())
    assert np.mean(beyond) == pytest.approx(0, abs=0.04)
