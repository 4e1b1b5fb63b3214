"""The paper's observation model, equation by equation, in float64 and batched over views.

A camera's pose is (theta_c, p_c), an object's (theta_o, p_o): axis-angle vectors and positions in the world, each (3,)
or with any batch in front, (..., 3); they broadcast against each other. The paper's 3 x n matrices are rows (n, 3), its
key point association A is (V, K).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry.arrays import AnyArray, Bytes, Floats, Ints
from meshslam.geometry.camera import Camera
from meshslam.geometry.lie import exp_so3, hat, right_jacobian
from meshslam.geometry.mask_iou_loss import MaskLoss
from meshslam.geometry.pose import Pose


def camera_points(
    theta_c: Floats, p_c: Floats, theta_o: Floats, p_o: Floats, vertices: Floats, association: Floats | None = None
) -> Floats:
    """R_cam = R_c^T (R_o V A + (p_o - p_c) 1^T), points (..., n, 3) in the camera's frame, metres (Eq. 8).

    `vertices` (..., V, 3) in the object's frame; `association` A (V, K), the identity if it is not given. GeometryError
    for a shape that does not fit, or a value that is not finite.
    """
    points = _checked("vertices", vertices, 3)
    if association is not None:
        weights = _checked("association", association)
        if weights.shape[-2:-1] != points.shape[-2:-1]:
            raise GeometryError(
                f"association has shape {weights.shape}, expected {points.shape[-2]} rows, one a vertex"
            )
        points = np.swapaxes(weights, -1, -2) @ points
    in_world = _in_world(theta_o, p_o, points) - _checked("p_c", p_c, 3)[..., None, :]
    in_camera: Floats = in_world @ exp_so3(_checked("theta_c", theta_c, 3))
    return in_camera


def keypoint_pixels(
    camera: Camera,
    theta_c: Floats,
    p_c: Floats,
    theta_o: Floats,
    p_o: Floats,
    vertices: Floats,
    association: Floats | None = None,
) -> Floats:
    """R_kps = K pi(R_cam), pixels (..., n, 2) (Eq. 6 and 8, K with skew as in Eq. 5).

    Points on or behind the image plane have no pixel: NaN. `vertices` and `association` as for `camera_points`.
    """
    return camera.project(camera_points(theta_c, p_c, theta_o, p_o, vertices, association))


def mesh_masks(
    camera: Camera, theta_c: Floats, p_c: Floats, theta_o: Floats, p_o: Floats, vertices: Floats, faces: Ints
) -> Bytes:
    """R_mask = Raster(R_cam, F), masks (..., height, width) of zeros and ones (Eq. 9).

    One mesh, `vertices` (V, 3) and `faces` (F, 3), in every view. A pixel is drawn where its centre lies in a face; on
    an edge the top-left rule decides. GeometryError for NaN, or a face that names no vertex.
    """
    named = {"theta_c": theta_c, "p_c": p_c, "theta_o": theta_o, "p_o": p_o}
    states = np.broadcast_arrays(*(_checked(name, values, 3) for name, values in named.items()))
    batch = states[0].shape[:-1]
    c, pc, o, po = (a.reshape(-1, 3) for a in states)
    drawer = MaskLoss(camera, len(vertices), faces, np.zeros((1, 1), np.uint8))
    out = np.empty((len(c), camera.height, camera.width), np.uint8)
    for k, (camera_rotation, object_rotation) in enumerate(zip(exp_so3(c), exp_so3(o), strict=True)):
        camera_from_object = Pose(camera_rotation, pc[k]).inverse() @ Pose(object_rotation, po[k])
        out[k] = drawer.draw(camera_from_object, vertices)
    return out.reshape(*batch, camera.height, camera.width)


def selection(detected: Ints, keypoint_count: int) -> Floats:
    """`vis` as a matrix (..., |K_n|, |K_lt|): column j picks the key point that was detected j-th (Eq. 2).

    `detected` (..., |K_lt|) holds indices among the object's `keypoint_count` key points. It says what was detected,
    not what hides itself. GeometryError for an index that no key point has.
    """
    indices = np.asarray(detected)
    if indices.dtype.kind not in "iu" and indices.size:
        raise GeometryError(f"detected key points are indices, found {indices.dtype}")
    if indices.size and not (indices.min() >= 0 and indices.max() < keypoint_count):
        bad = int(indices[(indices < 0) | (indices >= keypoint_count)].flat[0])
        raise GeometryError(f"key point {bad} is out of range: there are {keypoint_count}")
    return np.asarray(indices[..., None, :] == np.arange(keypoint_count)[:, None], float)


def keypoint_loss(observed: Floats, predicted: Floats, vis: Floats) -> Floats:
    """L_kps = ||y - y_hat vis||_F^2, squared pixels, one a view (Eq. 2).

    `observed` y (..., |K_lt|, 2), `predicted` y_hat (..., |K_n|, 2), `vis` (..., |K_n|, |K_lt|). A prediction may be
    NaN where `vis` discards it, else GeometryError.
    """
    return np.asarray((_keypoint_gap(observed, predicted, vis) ** 2).sum((-1, -2)))


def keypoint_loss_gradient(observed: Floats, predicted: Floats, vis: Floats) -> Floats:
    """Gradient 2 (y_hat vis - y) vis^T of L_kps over y_hat, (..., |K_n|, 2), pixels (Proposition 1, Eq. 11)."""
    gradient: Floats = -2.0 * vis @ _keypoint_gap(observed, predicted, vis)
    return gradient


def mask_loss(observed: Floats | Bytes, predicted: Floats | Bytes) -> Floats:
    """L_mask = -I/U with I = ||s s_hat||_1 and U = ||s + s_hat - s s_hat||_1, one a view (Eq. 2).

    Masks (..., h, w) with values from 0 to 1. Two empty masks agree: -1.
    """
    intersection, union = _areas(observed, predicted)
    return np.asarray(np.where(union > 0, -intersection / np.where(union > 0, union, 1.0), -1.0))


def mask_loss_gradient(observed: Floats | Bytes, predicted: Floats | Bytes) -> Floats:
    """Gradient -s/U + (1 - s) I/U^2 of L_mask over s_hat, (..., h, w) (Proposition 1, Eq. 11); 0 for empty masks."""
    intersection, union = (a[..., None, None] for a in _areas(observed, predicted))
    s, some = np.asarray(observed, float), union > 0
    u = np.where(some, union, 1.0)
    return np.asarray(np.where(some, -s / u + (1.0 - s) * intersection / u**2, 0.0))


def projection_derivative(camera: Camera, points_in_camera: Floats) -> Floats:
    """K d(pi)/dx at points (..., 3), as matrices (..., 2, 3), pixels a metre (Proposition 2, Eq. 12).

    NaN on or behind the image plane, where no pixel is.
    """
    return camera.projection_jacobian(_checked("points_in_camera", points_in_camera, 3))


@dataclass(frozen=True, eq=False)
class PixelDerivatives:
    """Derivatives of pixels y over the states, each (..., n, 2, 3)."""

    theta_c: Floats  # pixels a radian
    p_c: Floats  # pixels a metre
    theta_o: Floats
    p_o: Floats
    vertices: Floats  # each point's over itself in the object's frame


def pixel_derivatives(
    camera: Camera, theta_c: Floats, p_c: Floats, theta_o: Floats, p_o: Floats, points: Floats
) -> PixelDerivatives:
    """dy/d(alpha) = K d(pi)/dx(gamma) d(gamma)/d(alpha) over each state (Proposition 2, Eq. 12 and 13).

    `points` (..., n, 3) in the object's frame: vertices, or key points. Derivatives are over the axis-angle vectors
    themselves, through the right Jacobian. NaN where a point lies on or behind the image plane.
    """
    v = _checked("points", points, 3)
    from_camera = _in_world(theta_o, p_o, v) - np.asarray(p_c, float)[..., None, :]
    jacobian_c = right_jacobian(-_checked("theta_c", theta_c, 3))[..., None, :, :]
    jacobian_o = right_jacobian(theta_o)[..., None, :, :]
    outer = projection_derivative(camera, camera_points(theta_c, p_c, theta_o, p_o, v))
    camera_from_world = np.swapaxes(exp_so3(theta_c), -1, -2)[..., None, :, :]
    camera_from_object = camera_from_world @ exp_so3(theta_o)[..., None, :, :]
    return PixelDerivatives(
        theta_c=outer @ camera_from_world @ hat(from_camera) @ jacobian_c,
        p_c=-outer @ camera_from_world,
        theta_o=-outer @ camera_from_object @ hat(v) @ jacobian_o,
        p_o=outer @ camera_from_world,
        vertices=outer @ camera_from_object,
    )


def _checked(name: str, values: AnyArray, last: int | None = None) -> Floats:
    """Finite float64 whose last axis has `last` entries."""
    array = np.asarray(values, float)
    if array.ndim == 0 or (last is not None and array.shape[-1] != last):
        raise GeometryError(f"{name} has shape {array.shape}, expected (..., {'any' if last is None else last})")
    if not np.isfinite(array).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise GeometryError(f"{name} must be finite, but entry {index} is {array[index]}")
    return array


def _in_world(theta_o: Floats, p_o: Floats, points: Floats) -> Floats:
    rotation = exp_so3(_checked("theta_o", theta_o, 3))
    in_world: Floats = points @ np.swapaxes(rotation, -1, -2) + _checked("p_o", p_o, 3)[..., None, :]
    return in_world


def _keypoint_gap(observed: Floats, predicted: Floats, vis: Floats) -> Floats:
    y, y_hat, v = _checked("observed", observed, 2), np.asarray(predicted, float), _checked("vis", vis)
    if v.ndim < 2 or v.shape[-2:] != (y_hat.shape[-2], y.shape[-2]):
        raise GeometryError(f"vis has shape {v.shape}, expected (..., {y_hat.shape[-2]}, {y.shape[-2]})")
    has_pixel = np.isfinite(y_hat).all(-1)
    if (~has_pixel & (v != 0).any(-1)).any():
        index = tuple(int(i) for i in np.argwhere(~has_pixel & (v != 0).any(-1))[0])
        raise GeometryError(f"key point {index} was detected, but its prediction lies on or behind the image plane")
    gap: Floats = y - np.swapaxes(v, -1, -2) @ np.where(has_pixel[..., None], y_hat, 0.0)
    return gap


def _areas(observed: AnyArray, predicted: AnyArray) -> tuple[Floats, Floats]:
    s, p = _checked("observed", observed), _checked("predicted", predicted)
    if s.ndim < 2 or s.shape[-2:] != p.shape[-2:]:
        raise GeometryError(f"masks must have one size, found {s.shape} and {p.shape}")
    return (s * p).sum((-1, -2)), (s + p - s * p).sum((-1, -2))
