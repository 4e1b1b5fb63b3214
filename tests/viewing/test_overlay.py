import cv2
import numpy as np
import pytest

from meshslam.errors import GeometryError
from meshslam.geometry import Pose, mask_iou, render
from meshslam.maps import Map, object_colour
from meshslam.viewing import draw_overlay
from meshslam.viewing.mesh_layer import laid_over, mesh_layer, scaled_camera, shapes_of
from meshslam.viewing.overlay import LABEL_HEIGHT_PX, keypoint_colour, label_width, mask_contours, place_labels
from tests.reference import mesh_layer as reference


def picture(layer, camera):
    """The whole layer (h, w, 4)."""
    whole = np.zeros((camera.height, camera.width, 4), np.uint8)
    for patch in layer.patches:
        assert not whole[patch.inside].any()
        whole[patch.inside] = patch.bgra
    return whole


@pytest.mark.parametrize("seed", range(12))
def test_the_layer_equals_its_slow_twin(seed, camera, path, make_car):
    rng = np.random.default_rng(seed)
    places = zip(rng.uniform(-4, 30, 7), rng.uniform(-9, 9, 7), rng.uniform(-3, 3, 7), strict=True)
    shapes = shapes_of(Map(tuple(make_car(i, x, y, yaw) for i, (x, y, yaw) in enumerate(places))))
    layer = mesh_layer(camera, path[0], shapes, faint={2, 3})
    expected, boxes = reference.mesh_layer(camera, path[0], shapes, faint={2, 3})
    assert expected.any()
    np.testing.assert_array_equal(picture(layer, camera), expected)
    assert {n: tuple(box) for n, box in layer.boxes.items()} == boxes


def test_only_what_meshes_reach_is_kept(camera, path, make_car):
    apart = shapes_of(Map((make_car(1, 20.0, 5.0), make_car(2, 20.0, -5.0), make_car(3, 24.0, -5.0))))
    layer = mesh_layer(camera, path[0], apart)
    assert len(layer.patches) == 2
    kept = sum(patch.bgra[..., 0].size for patch in layer.patches)
    assert kept < 0.15 * camera.width * camera.height


def test_a_mesh_is_drawn_where_its_mask_is(camera, path, cars):
    for thing in cars.objects:
        layer = mesh_layer(camera, path[0], shapes_of(Map((thing,))))
        camera_from_object = path[0].inverse() @ thing.world_from_object
        mask = render(camera, [(camera_from_object, thing.vertices, thing.faces)]).mask
        assert mask_iou(picture(layer, camera)[..., 3] > 30, mask) > 0.93
        rows, columns = np.nonzero(mask)
        corners = [columns.min() - 0.5, rows.min() - 0.5, columns.max() + 0.5, rows.max() + 0.5]
        np.testing.assert_allclose(layer.boxes[thing.id], corners, atol=0.8)


def test_the_nearer_is_in_front(camera, path, make_car):
    near, far = make_car(1, 10.0, 0.0), make_car(2, 18.0, 0.0)
    expected = picture(mesh_layer(camera, path[0], shapes_of(Map((near,)))), camera)
    for pair in ((near, far), (far, near)):
        shapes = tuple(shapes_of(Map(pair))[:: 1 if pair[0] is near else -1])
        drawn = picture(mesh_layer(camera, path[0], shapes), camera)
        inside = cv2.erode((expected[..., 3] > 0).astype(np.uint8), np.ones((5, 5))) > 0
        np.testing.assert_array_equal(drawn[inside], expected[inside])


def test_colours_are_the_objects_own(camera, path, make_car):
    layer = picture(mesh_layer(camera, path[0], shapes_of(Map((make_car(5, 9.0, 0.0),)))), camera)
    inside = layer[..., 3] > 60
    mean = layer[inside][:, :3].mean(axis=0)
    own = object_colour(5)[::-1].astype(float)
    assert (mean @ own) / np.linalg.norm(mean) / np.linalg.norm(own) > 0.97


def test_an_object_behind_the_camera_leaves_no_trace(camera, path, make_car):
    layer = mesh_layer(camera, path[0], shapes_of(Map((make_car(1, -9.0, 0.0),))))
    assert layer.patches == ()
    assert layer.boxes == {}


def test_nothing_to_draw_leaves_the_image(camera, path, rng):
    image = rng.integers(0, 255, (camera.height, camera.width, 3), dtype=np.uint8)
    drawn = draw_overlay(image, camera, path[0], Map(()), ())
    np.testing.assert_array_equal(drawn, image)
    assert drawn is not image


def test_draws_meshes_masks_boxes_and_key_points(camera, path, cars, detections):
    found = detections.by_frame()[0]
    blank = draw_overlay(None, camera, path[0], Map(()), ())
    drawn = draw_overlay(None, camera, path[0], cars, found)
    changed = (drawn != blank).any(axis=2)
    for d in found:
        inside = d.mask() > 0
        assert changed[inside].mean() > 0.95
    assert not changed[camera.height - 4 :, :30].any()
    points = [p for d in found if d.keypoints is not None for p in d.keypoints[1::2]]
    assert points
    assert blank.std() == 0


def test_a_detection_outside_the_map_is_grey(camera, path, detections):
    stray = [d for d in detections.detections if d.track_id is None]
    drawn = draw_overlay(None, camera, path[0], Map(()), stray)
    assert (drawn.max(axis=2) == drawn.min(axis=2)).all()
    assert (drawn != drawn[-1, -1]).any()


def test_an_image_of_another_size_is_refused(camera, path, cars):
    with pytest.raises(GeometryError, match=r"\(140, 400, 3\), found \(10, 20, 3\)"):
        draw_overlay(np.zeros((10, 20, 3), np.uint8), camera, path[0], cars, ())


def test_a_scaled_camera_sees_the_same(camera, rng):
    points = np.column_stack([rng.uniform(-2, 2, (50, 2)), rng.uniform(2, 20, 50)])
    small = scaled_camera(camera, 0.5)
    ratio = np.array([small.width / camera.width, small.height / camera.height])
    np.testing.assert_allclose(small.project(points) + 0.5, (camera.project(points) + 0.5) * ratio, atol=1e-9)


def test_laying_over_is_a_mix(rng):
    image = rng.integers(0, 255, (6, 5, 3), dtype=np.uint8)
    layer = rng.integers(0, 255, (6, 5, 4), dtype=np.uint8)
    share = layer[..., 3:] / 255
    np.testing.assert_allclose(laid_over(image, layer), image * (1 - share) + layer[..., :3] * share, atol=0.51)


def test_labels_do_not_hide_each_other(rng):
    corners = rng.uniform([0, 250], [500, 300], (25, 2))
    sizes = rng.uniform(5, 60, (25, 2))
    boxes = {7 * i: (*c, *(c + s)) for i, (c, s) in enumerate(zip(corners, sizes, strict=True))}
    placed = place_labels(boxes)
    assert len(placed) > 15
    rows = [(x, y, x + label_width(n), y + LABEL_HEIGHT_PX) for n, (x, y) in placed.items() if y > 0]
    for i, a in enumerate(rows):
        for b in rows[i + 1 :]:
            assert min(a[2], b[2]) - max(a[0], b[0]) <= 1e-9 or min(a[3], b[3]) - max(a[1], b[1]) <= 1e-9


def test_small_faint_boxes_have_no_label():
    boxes = {1: (0.0, 50.0, 20.0, 60.0), 2: (100.0, 50.0, 150.0, 80.0), 3: (200.0, 50.0, 203.0, 53.0)}
    assert set(place_labels(boxes)) == {1, 2}
    assert set(place_labels(boxes, faint={1, 2, 3})) == {2}


def test_contours_lie_on_the_border_of_the_mask(cars, camera, path):
    thing = cars.objects[0]
    pose: Pose = path[0].inverse() @ thing.world_from_object
    mask = render(camera, [(pose, thing.vertices, thing.faces)]).mask
    mask[60:64, 60:64] = 0
    padded = np.pad(mask, 1)
    for x, y in np.concatenate(mask_contours(mask)).astype(int):
        assert padded[y : y + 3, x : x + 3].min() == 0


@pytest.mark.parametrize("count", [1, 12, 17])
def test_key_points_have_different_colours(count):
    assert len({keypoint_colour(i, count) for i in range(count)}) == count
