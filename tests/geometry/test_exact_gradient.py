"""The exact gradient against central differences of a supersampled area IoU, also where a mesh hides itself."""

import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.errors import GeometryError
from meshslam.geometry import Camera, MaskLoss, Pose, exp_so3, mask_gradients, render
from tests.reference import area_iou, meshes

CAMERA = Camera(620, 188, 721.5, 721.5, 310.0, 90.0, 1.3)
CAR = load_category("car")
BODY = (CAR.vertices, CAR.faces)
MESHES = {
    "car": BODY,
    "mirrors and wheels": meshes.with_mirrors_and_wheels(BODY),
    "L-shape": meshes.l_shape(),
    "nested shells": meshes.nested_shells(),
    "crossing shells": meshes.crossing_shells(),
    "open half": meshes.open_half(*BODY),
}
AHEAD = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])  # camera from an object that faces away
TILT = exp_so3(np.array([0.11, 0.03, 0.17]))  # so that no edge follows a row or column of samples


def pose_at(distance_m, yaw_rad=0.7, aside_m=0.0):
    turned = TILT @ AHEAD @ Pose.from_yaw(yaw_rad, np.zeros(3)).rotation
    return Pose(turned, np.array([aside_m, 0.9, distance_m]))


def scene(mesh, distance_m, yaw_rad=0.7):
    """Pose, vertices, faces, and the mask of the same thing a little larger, turned and moved."""
    vertices, faces = mesh
    observed = render(CAMERA, [(pose_at(distance_m, yaw_rad + 0.05, 0.15), vertices * 1.03, faces)]).mask
    return pose_at(distance_m, yaw_rad), vertices, faces, observed


def exact(pose, vertices, faces, observed):
    return MaskLoss(CAMERA, len(vertices), faces, observed).gradient(pose, vertices)


def cosine(a, b):
    return float((a * b).sum() / np.linalg.norm(a) / np.linalg.norm(b))


@pytest.mark.parametrize("distance_m", [8.0, 15.0, 30.0])
@pytest.mark.parametrize("name", MESHES)
def test_over_the_pose(name, distance_m):
    case = scene(MESHES[name], distance_m)
    found, numeric = exact(*case).object, area_iou.pose_gradient(CAMERA, *case)
    assert cosine(found, numeric) > 0.999
    assert np.linalg.norm(found) == pytest.approx(np.linalg.norm(numeric), rel=0.03)


@pytest.mark.parametrize("distance_m", [8.0, 15.0, 30.0])
@pytest.mark.parametrize("name", MESHES)
def test_over_vertices(name, distance_m, rng):
    case = scene(MESHES[name], distance_m)
    found = exact(*case).vertices
    moving = np.flatnonzero(np.abs(found).sum(1) > 0)
    still = np.setdiff1d(np.unique(case[2]), moving)
    chosen = np.concatenate([rng.permutation(moving)[:60], rng.permutation(still)[:5]])
    numeric = area_iou.vertex_gradient(CAMERA, *case, chosen)
    assert cosine(found[chosen], numeric) > 0.99
    assert np.abs(numeric[60:]).max(initial=0.0) < 0.02 * np.abs(numeric).max()


def test_a_hidden_shell_adds_nothing():
    vertices, faces = MESHES["nested shells"]
    pose, _, _, observed = scene(MESHES["nested shells"], 8.0)
    outer = len(vertices) // 2
    both, alone = (
        exact(pose, vertices[:n], f, observed) for n, f in ((None, faces), (outer, faces[faces.max(1) < outer]))
    )
    np.testing.assert_allclose(both.vertices[:outer], alone.vertices, atol=1e-15)
    assert not both.vertices[outer:].any()
    np.testing.assert_allclose(both.object, alone.object, atol=1e-15)


def test_the_camera_moves_as_the_opposite_of_the_object_in_its_own_frame():
    pose, vertices, faces, observed = scene(BODY, 8.0)
    found = exact(pose, vertices, faces, observed)
    np.testing.assert_allclose(found.camera[:3], -pose.rotation @ found.object[:3], atol=1e-12)
    # world_from_camera exp(xi): the object moves by exp(-xi) in the camera
    lever = np.cross(pose.translation, pose.rotation @ found.object[:3]) + pose.rotation @ found.object[3:]
    np.testing.assert_allclose(found.camera[3:], -lever, atol=1e-12)


def test_many_views_give_what_each_gives_alone():
    cases = [scene(BODY, d) for d in (8.0, 12.0, 20.0)]
    losses = [MaskLoss(CAMERA, len(CAR.vertices), CAR.faces, case[3]) for case in cases]
    for threads in (1, 2):
        together = mask_gradients(losses, [case[0] for case in cases], CAR.vertices, threads)
        for case, found in zip(cases, together, strict=True):
            alone = exact(*case)
            np.testing.assert_array_equal(found.vertices, alone.vertices)
            np.testing.assert_array_equal(found.camera, alone.camera)


@pytest.mark.parametrize("name", ["car", "open half"])
def test_calls_before_change_nothing(name):
    pose, vertices, faces, observed = scene(MESHES[name], 12.0)
    loss = MaskLoss(CAMERA, len(vertices), faces, observed)
    first = loss.gradient(pose, vertices)
    for scale in (1.0, 1.0, 1.0, 1.0, 1.0, 1.02, 1.0):  # the mesh is prepared on the way, then another comes between
        loss.gradient(pose, vertices * scale)
    again = loss.gradient(pose, vertices)
    np.testing.assert_array_equal(again.vertices, first.vertices)
    np.testing.assert_array_equal(again.object, first.object)
    moved = vertices.copy()
    moved[0] = np.nan
    with pytest.raises(GeometryError, match="finite"):
        loss.gradient(pose, moved)
    np.testing.assert_array_equal(loss.gradient(pose, vertices).vertices, first.vertices)


def test_losses_of_one_mesh_and_of_others_keep_apart():
    pose, vertices, faces, observed = scene(BODY, 12.0)
    half = MESHES["open half"][1]
    losses = [MaskLoss(CAMERA, len(vertices), f, observed) for f in (faces, half, faces, half)]
    together = mask_gradients(losses, [pose] * 4, vertices, 2)
    for loss, found in zip(losses, together, strict=True):
        np.testing.assert_array_equal(found.vertices, loss.gradient(pose, vertices).vertices)
    assert np.abs(together[0].vertices - together[1].vertices).max() > 0
