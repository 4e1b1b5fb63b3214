"""Poses, cameras, meshes, rendering and their derivatives: the only room that imports the native module."""

from meshslam.geometry.camera import Camera
from meshslam.geometry.lie import exp_so3, hat, log_so3, right_jacobian
from meshslam.geometry.mask_loss import MaskGradient, MaskLoss, kato_pixel_gradient, mask_gradients
from meshslam.geometry.object_model import (
    GroundPlane,
    Iteration,
    NoiseModel,
    ObjectModel,
    ObjectState,
    Refined,
    SquareRoot,
    View,
)
from meshslam.geometry.pose import Pose, nearest_rotation
from meshslam.geometry.rendering import Outline, Rendering, outline, render
from meshslam.geometry.shapes import cotangent_weights, mask_iou, voxel_iou
from meshslam.geometry.triangulation import kabsch, triangulate

__all__ = [
    "Camera",
    "GroundPlane",
    "Iteration",
    "MaskGradient",
    "MaskLoss",
    "NoiseModel",
    "ObjectModel",
    "ObjectState",
    "Outline",
    "Pose",
    "Refined",
    "Rendering",
    "SquareRoot",
    "View",
    "cotangent_weights",
    "exp_so3",
    "hat",
    "kabsch",
    "kato_pixel_gradient",
    "log_so3",
    "mask_gradients",
    "mask_iou",
    "nearest_rotation",
    "outline",
    "render",
    "right_jacobian",
    "triangulate",
    "voxel_iou",
]
