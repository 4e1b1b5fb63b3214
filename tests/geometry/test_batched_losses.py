"""Exact areas and their derivatives, in batches: against supersampling, central differences, and one view at a time."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.ndimage import maximum_filter, minimum_filter

from meshslam.categories import load_category
from meshslam.errors import GeometryError
from meshslam.geometry import (
    Camera,
    MaskLoss,
    Pose,
    batched_keypoint_loss,
    batched_mask_loss,
    batched_silhouette_gradients,
    batched_silhouettes,
    exp_so3,
    keypoint_loss,
    mask_loss,
    render,
    selection,
    summed_over_views,
)
from tests.reference import area_iou, meshes

CAMERA = Camera(320, 100, 370.0, 365.0, 160.0, 48.0, 1.3)
CAR = load_category("car")
BODY = (CAR.vertices, CAR.faces)
AHEAD = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])  # camera from an object that faces away
TILT = exp_so3(np.array([0.11, 0.03, 0.17]))


def soup(vertices, faces):
    """Every face with vertices of its own, every other one turned: as STL files may have it."""
    turned = np.where(np.arange(len(faces))[:, None] % 2, faces, faces[:, ::-1])
    return vertices[turned].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)


MESHES = {
    "car": BODY,
    "mirrors and wheels": meshes.with_mirrors_and_wheels(BODY),
    "L-shape": meshes.l_shape(),
    "crossing shells": meshes.crossing_shells(),
    "open": meshes.open_half(*BODY),
    "soup": soup(*meshes.l_shape()),
    "sheet": (np.array([[0.0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]]), np.array([[0, 1, 2], [0, 2, 3]])),
}
# the nearest ones are cut by the near plane and by the image's edge
DISTANCES_M = (1.2, 2.5, 8.0, 25.0)


def pose_at(distance_m, yaw_rad=0.7, aside_m=0.0):
    turned = TILT @ AHEAD @ Pose.from_yaw(yaw_rad, np.zeros(3)).rotation
    return Pose(turned, np.array([aside_m, 0.5, distance_m]))


def observed(mesh, distance_m):
    return render(CAMERA, [(pose_at(distance_m, 0.75, 0.15), mesh[0] * 1.03, mesh[1])]).mask


@pytest.mark.parametrize("distance_m", DISTANCES_M)
@pytest.mark.parametrize("name", MESHES)
def test_shares_are_those_of_many_samples(name, distance_m):
    (vertices, faces), pose = MESHES[name], pose_at(distance_m)
    found = batched_silhouettes(vertices, faces, pose.matrix, CAMERA)
    rect = (0, 0, CAMERA.width, CAMERA.height)
    twin = area_iou.shares(CAMERA, pose, vertices, faces, rect, 24)
    assert np.abs(found - twin).max() < 0.04  # 24 x 24 samples: an edge is off by half a row of them
    assert abs(found.sum() - twin.sum()) < 1e-4 * twin.sum() + 0.02
    calm = maximum_filter(twin, 3) == minimum_filter(twin, 3)  # away from the border nothing is rounded
    np.testing.assert_array_equal(found[calm], twin[calm])


@pytest.mark.parametrize("distance_m", DISTANCES_M[1:])
@pytest.mark.parametrize("name", ["car", "mirrors and wheels", "L-shape", "crossing shells"])
def test_the_contour_says_what_all_edges_say(name, distance_m):
    (vertices, faces), matrix = MESHES[name], pose_at(distance_m).matrix
    twice = np.concatenate([faces, faces[:1]])  # no closed surface: every pair of edges is compared
    by_contour, by_edges = (batched_silhouettes(vertices, f, matrix, CAMERA) for f in (faces, twice))
    np.testing.assert_allclose(by_contour, by_edges, atol=1e-9)
    mask = observed(MESHES[name], distance_m)
    by_contour, by_edges = (batched_mask_loss(vertices, f, matrix, CAMERA, mask) for f in (faces, twice))
    np.testing.assert_allclose(by_contour.vertices, by_edges.vertices, atol=1e-9)


@pytest.mark.parametrize("distance_m", DISTANCES_M)
@pytest.mark.parametrize("name", MESHES)
def test_gradients_are_central_differences_of_the_loss(name, distance_m, rng):
    (vertices, faces), matrix, mask = MESHES[name], pose_at(distance_m).matrix, observed(MESHES[name], distance_m)

    def loss(points, pose):
        return float(batched_mask_loss(points, faces, pose, CAMERA, mask, with_gradient=False).losses)

    found = batched_mask_loss(vertices, faces, matrix, CAMERA, mask)
    assert float(found.losses) == loss(vertices, matrix)
    step = 1e-6
    for _ in range(4):
        v, p = rng.normal(size=vertices.shape), np.vstack([rng.normal(size=(3, 4)), np.zeros((1, 4))])
        if name == "soup":  # its copies of a vertex move together: apart, they tear the surface
            _, same = np.unique(vertices, axis=0, return_inverse=True)
            v = rng.normal(size=vertices.shape)[same.ravel()]
        numeric = (loss(vertices + step * v, matrix) - loss(vertices - step * v, matrix)) / (2 * step)
        assert (found.vertices * v).sum() == pytest.approx(numeric, rel=1e-4, abs=1e-6)
        numeric = (loss(vertices, matrix + step * p) - loss(vertices, matrix - step * p)) / (2 * step)
        assert (found.camera_from_object * p).sum() == pytest.approx(numeric, rel=1e-4, abs=1e-6)


@pytest.mark.parametrize("name", MESHES)
def test_the_loss_is_that_of_the_silhouette(name):
    vertices, faces = MESHES[name]
    drawn = batched_silhouettes(vertices, faces, pose_at(8.0).matrix, CAMERA)
    for mask in (observed(MESHES[name], 8.0), np.linspace(0, 1, drawn.size).reshape(drawn.shape)):
        found = batched_mask_loss(vertices, faces, pose_at(8.0).matrix, CAMERA, mask).losses
        assert float(found) == pytest.approx(float(mask_loss(mask, drawn)), rel=1e-12)


def test_any_loss_goes_back_through_silhouettes(rng):
    vertices, faces = BODY
    matrix, slopes = pose_at(8.0).matrix, rng.normal(size=(CAMERA.height, CAMERA.width))
    of_vertices, of_pose = batched_silhouette_gradients(vertices, faces, matrix, CAMERA, slopes)
    v, p, step = rng.normal(size=vertices.shape), np.vstack([rng.normal(size=(3, 4)), np.zeros((1, 4))]), 1e-6

    def value(by):
        return (slopes * batched_silhouettes(vertices + by * v, faces, matrix + by * p, CAMERA)).sum()

    numeric = (value(step) - value(-step)) / (2 * step)
    assert (of_vertices * v).sum() + (of_pose * p).sum() == pytest.approx(numeric, rel=1e-5)


def test_katos_gradient_and_its_loss_are_those_of_a_mask_loss():
    pose, mask = pose_at(8.0), observed(BODY, 8.0)
    alone = MaskLoss(CAMERA, len(CAR.vertices), CAR.faces, mask).gradient(pose, CAR.vertices, "kato")
    for values in (mask, mask.astype(bool), mask.astype(np.float32)):
        found = batched_mask_loss(*BODY, pose.matrix, CAMERA, values, gradient="kato")
        np.testing.assert_array_equal(found.vertices, alone.vertices)
        assert found.losses == alone.loss
        bare = batched_mask_loss(*BODY, pose.matrix, CAMERA, values, gradient="kato", with_gradient=False)
        assert bare.losses == alone.loss
    moved = found.camera_from_object[:3, 3]
    np.testing.assert_allclose(moved, -alone.camera[:3], atol=1e-12)


def batch(count):
    poses = np.stack([pose_at(6.0 + k, 0.3 * k, 0.2 * k).matrix for k in range(count)])
    cameras = [Camera(320, 100, 370.0 + 5 * k, 365.0, 160.0 - k, 48.0, 1.3) for k in range(count)]
    return poses, cameras, np.stack([observed(BODY, 7.0 + k) for k in range(count)])


@pytest.mark.parametrize("gradient", ["exact", "kato"])
def test_a_batch_gives_the_bits_that_each_view_gives_alone_on_any_number_of_threads(gradient):
    poses, cameras, masks = batch(9)
    whole = batched_mask_loss(*BODY, poses, cameras, masks, gradient=gradient, threads=1)
    assert whole.vertices.shape == (9, *CAR.vertices.shape)
    for threads in (0, 2, 3):
        again = batched_mask_loss(*BODY, poses, cameras, masks, gradient=gradient, threads=threads)
        for name in ("losses", "vertices", "camera_from_object"):
            np.testing.assert_array_equal(getattr(again, name), getattr(whole, name))
    for k in range(9):
        alone = batched_mask_loss(*BODY, poses[k], cameras[k], masks[k], gradient=gradient)
        assert alone.losses == whole.losses[k]
        np.testing.assert_array_equal(alone.vertices, whole.vertices[k])
        np.testing.assert_array_equal(alone.camera_from_object, whole.camera_from_object[k])
    drawn = batched_silhouettes(*BODY, poses, cameras, threads=2)
    for k in range(9):
        np.testing.assert_array_equal(drawn[k], batched_silhouettes(*BODY, poses[k], cameras[k]))


def test_objects_and_views_broadcast():
    poses, cameras, masks = batch(3)
    objects = np.stack([CAR.vertices, 1.1 * CAR.vertices])[:, None]
    found = batched_mask_loss(objects, CAR.faces, poses, cameras, masks)
    assert found.losses.shape == (2, 3)
    for i, k in np.ndindex(2, 3):
        alone = batched_mask_loss(objects[i, 0], CAR.faces, poses[k], cameras[k], masks[k])
        np.testing.assert_array_equal(found.vertices[i, k], alone.vertices)
    weights = np.arange(6.0).reshape(2, 3)
    summed = summed_over_views(found.vertices, (2, 1), weights)
    expected = sum(weights[:, k, None, None] * found.vertices[:, k] for k in range(3))
    np.testing.assert_array_equal(summed[:, 0], expected)


def test_strides_and_types_change_nothing_but_rounding():
    poses, cameras, masks = batch(3)
    whole = batched_mask_loss(*BODY, poses, cameras, masks)
    strided = np.asfortranarray(np.repeat(CAR.vertices, 2, axis=0))[::2]
    turned = np.ascontiguousarray(np.moveaxis(masks, 0, -1))
    again = batched_mask_loss(
        strided, CAR.faces[:, ::-1][:, ::-1], poses[::-1][::-1], cameras, np.moveaxis(turned, -1, 0)
    )
    np.testing.assert_array_equal(again.vertices, whole.vertices)
    for kind in (bool, np.float32, np.float64):
        np.testing.assert_allclose(batched_mask_loss(*BODY, poses, cameras, masks.astype(kind)).losses, whole.losses)
    np.testing.assert_array_equal(batched_mask_loss(*BODY, poses, cameras, masks * 255).losses, whole.losses)
    single = batched_mask_loss(CAR.vertices.astype(np.float32), CAR.faces.astype(np.int32), poses, cameras, masks)
    assert single.losses.dtype == single.vertices.dtype == single.camera_from_object.dtype == np.float32
    np.testing.assert_allclose(single.losses, whole.losses, atol=1e-5)
    assert batched_silhouettes(CAR.vertices.astype(np.float32), CAR.faces, poses, cameras).dtype == np.float32


def test_nothing_in_gives_nothing_out():
    none = batched_mask_loss(*BODY, np.zeros((0, 4, 4)), CAMERA, np.zeros((0, 100, 320), np.uint8))
    assert none.losses.shape == (0,)
    assert none.vertices.shape == (0, 642, 3)
    bare = batched_mask_loss(np.zeros((0, 3)), np.zeros((0, 3), int), np.eye(4), CAMERA, np.zeros((100, 320), bool))
    assert bare.losses == -1.0
    behind = batched_mask_loss(*BODY, pose_at(-50.0).matrix, CAMERA, observed(BODY, 8.0))
    assert behind.losses == 0.0
    assert not behind.vertices.any()
    assert summed_over_views(np.zeros((0, 4, 3)), ()).shape == (4, 3)


def test_key_points_are_those_of_the_paper():
    rng = np.random.default_rng(4)
    poses, cameras, _ = batch(4)
    association = CAR.keypoint_weights.T
    count = association.shape[1]
    visible, pixels = rng.random((4, count)) < 0.6, rng.normal(50, 30, size=(4, count, 2))
    pixels[~visible] = np.nan
    found = batched_keypoint_loss(CAR.vertices, association, poses, cameras, pixels, visible)
    for k in range(4):
        points = association.T @ CAR.vertices @ poses[k, :3, :3].T + poses[k, :3, 3]
        seen = np.flatnonzero(visible[k])
        paper = keypoint_loss(pixels[k][seen], cameras[k].project(points), selection(seen, count))
        assert found.losses[k] == pytest.approx(float(paper), rel=1e-12)
    v, p, step = rng.normal(size=CAR.vertices.shape), np.zeros((4, 4)), 1e-6
    p[:3] = rng.normal(size=(3, 4))

    def losses(by):
        return batched_keypoint_loss(
            CAR.vertices + by * v, association, poses + by * p, cameras, pixels, visible
        ).losses

    numeric = (losses(step) - losses(-step)) / (2 * step)
    np.testing.assert_allclose(
        (found.vertices * v).sum((1, 2)) + (found.camera_from_object * p).sum((1, 2)), numeric, rtol=1e-6
    )


NAN = np.full((642, 3), np.nan)
EYE, SEEN = pose_at(8.0).matrix, np.zeros((100, 320), np.uint8)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((NAN, CAR.faces, EYE, CAMERA, SEEN), "vertices must be finite"),
        ((CAR.vertices, CAR.faces, EYE + np.inf, CAMERA, SEEN), "camera_from_object must be finite"),
        ((CAR.vertices, CAR.faces + 1, EYE, CAMERA, SEEN), "names vertex 642"),
        ((CAR.vertices, CAR.faces.astype(float), EYE, CAMERA, SEEN), "faces are indices"),
        ((CAR.vertices, CAR.faces, EYE[:3], CAMERA, SEEN), r"camera_from_object \(..., 4, 4\)"),
        ((CAR.vertices[:, :2], CAR.faces, EYE, CAMERA, SEEN), r"vertices must have shape"),
        ((CAR.vertices, CAR.faces, EYE, CAMERA, SEEN[:50]), "the camera's image"),
        ((CAR.vertices, CAR.faces, EYE, CAMERA, SEEN + 1.5), "from 0 to 1"),
        ((CAR.vertices, CAR.faces, EYE, CAMERA, SEEN * np.nan), "from 0 to 1"),
        ((CAR.vertices, CAR.faces, EYE, CAMERA, SEEN.astype(int)), "masks must be bool"),
        ((CAR.vertices + 0j, CAR.faces, EYE, CAMERA, SEEN), "found complex128"),
        ((CAR.vertices, CAR.faces, EYE, [], SEEN), "images of one size"),
        ((CAR.vertices, CAR.faces, EYE, [CAMERA, Camera(9, 9, 9, 9, 9, 9)], SEEN), "images of one size"),
        ((np.stack([CAR.vertices] * 2), CAR.faces, np.stack([EYE] * 3), CAMERA, SEEN), "do not go together"),
    ],
)
def test_what_cannot_be_used_is_named(arguments, words):
    with pytest.raises(GeometryError, match=words):
        batched_mask_loss(*arguments)


def test_a_mask_of_shares_has_no_katos_gradient():
    with pytest.raises(GeometryError, match="0 or 1 for Kato"):
        batched_mask_loss(*BODY, EYE, CAMERA, SEEN + 0.5, gradient="kato")
    with pytest.raises(GeometryError, match="'exact' or 'kato'"):
        batched_mask_loss(*BODY, EYE, CAMERA, SEEN, gradient="soft")


def test_a_visible_key_point_behind_the_camera_is_an_error():
    association, pixels = np.eye(642)[:, :2], np.zeros((2, 2))
    with pytest.raises(GeometryError, match="the depth of a key point"):
        batched_keypoint_loss(CAR.vertices, association, pose_at(-8.0).matrix, CAMERA, pixels, [True, True])
    assert (
        batched_keypoint_loss(CAR.vertices, association, pose_at(-8.0).matrix, CAMERA, pixels, [False] * 2).losses == 0
    )
    with pytest.raises(GeometryError, match="observed, where visible, must be finite"):
        batched_keypoint_loss(CAR.vertices, association, EYE, CAMERA, pixels * np.nan, [True, True])
    with pytest.raises(GeometryError, match="association has 2 key points"):
        batched_keypoint_loss(CAR.vertices, association, EYE, CAMERA, np.zeros((3, 2)), [True] * 3)


def test_masks_are_read_in_place():
    code = """
from pathlib import Path
import numpy as np
from meshslam.categories import load_category
from meshslam.geometry import Camera, batched_mask_loss

def most_mb():
    line = next(x for x in Path("/proc/self/status").read_text().splitlines() if x.startswith("VmHWM"))
    return int(line.split()[1]) / 1024

car, camera, pose = load_category("car"), Camera(8000, 8000, 300.0, 300.0, 4000.0, 4000.0), np.eye(4)
pose[2, 3] = 9.0
masks = np.ones((8000, 8000), np.uint8)  # 61 MB
batched_mask_loss(car.vertices, car.faces, pose, Camera(9, 9, 9.0, 9.0, 4.0, 4.0), masks[:9, :9])
before = most_mb()
batched_mask_loss(car.vertices, car.faces, pose, camera, masks)
print(most_mb() - before)
"""
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert float(shown) < 20
