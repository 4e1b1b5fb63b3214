"""Relative motion of a camera between two images, up to the length of the translation, from point tracks."""

from __future__ import annotations

import cv2
import numpy as np

from meshslam.geometry import Camera, Floats, Pose

_LEAST_MATCHES = 12
_INLIER_PX, _CONFIDENCE = 0.7, 0.9999
_LEAST_PARALLAX_PX = 0.3  # in the median, once the rotation is removed: below it the camera stands still


def two_views(matches: Floats, camera: Camera) -> Pose:
    """first_from_second from corners (n, 2, 2) px in both; the translation is a unit vector, or 0 where it stands.

    By the essential matrix (Nister 2004), RANSAC and a fit to all that agree; the identity with fewer than 12 corners.
    """
    if len(matches) < _LEAST_MATCHES:
        return Pose.identity()
    rays = camera.rays(matches)
    first, second = (np.ascontiguousarray(rays[:, i, :2] / rays[:, i, 2:]) for i in range(2))
    found = cv2.findEssentialMat(first, second, np.eye(3), cv2.USAC_ACCURATE, _CONFIDENCE, _INLIER_PX / camera.fx)
    essential, inliers = found[0], found[1]
    if essential is None or essential.shape != (3, 3):
        return Pose.identity()
    _, turn, shift, _ = cv2.recoverPose(essential, first, second, np.eye(3), mask=inliers)
    first_from_second = Pose(np.asarray(turn, float), np.asarray(shift, float).ravel()).inverse()
    turned = rays[:, 1] @ first_from_second.rotation.T
    parallax = camera.fx * np.linalg.norm(turned[:, :2] / turned[:, 2:] - first, axis=1)
    if float(np.median(parallax)) < _LEAST_PARALLAX_PX:
        return Pose(first_from_second.rotation, np.zeros(3))
    return first_from_second
