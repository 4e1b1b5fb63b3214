"""Poses, cameras, meshes, rendering and their derivatives: the only room that imports the native module."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.geometry.arrays import AnyArray, Bools, Bytes, Floats, Ints, Singles
    from meshslam.geometry.assignment import best_pairs
    from meshslam.geometry.batched_losses import (
        Cameras,
        Intrinsics,
        Reals,
        ViewLosses,
        batched_keypoint_loss,
        batched_mask_loss,
        batched_silhouette_gradients,
        batched_silhouettes,
        intrinsics_of,
        reals,
        summed_over_views,
    )
    from meshslam.geometry.block_system import (
        BlockSystem,
        LinearFactor,
        Solution,
        VariableGroup,
        Variables,
        linear_cost,
    )
    from meshslam.geometry.camera import Camera
    from meshslam.geometry.gltf_check import check_gltf, is_gltf
    from meshslam.geometry.lie import cross_matrix, exp_so3, hat, log_so3, right_jacobian, right_jacobian_inverse
    from meshslam.geometry.mask_iou_loss import MaskGradient, MaskLoss, kato_pixel_gradient, mask_gradients
    from meshslam.geometry.object_model import (
        Block,
        GroundPlane,
        Iteration,
        NoiseModel,
        ObjectModel,
        ObjectState,
        Refined,
        SquareRoot,
        View,
    )
    from meshslam.geometry.observation import (
        PixelDerivatives,
        camera_points,
        keypoint_loss,
        keypoint_loss_gradient,
        keypoint_pixels,
        mask_loss,
        mask_loss_gradient,
        mesh_masks,
        pixel_derivatives,
        projection_derivative,
        selection,
    )
    from meshslam.geometry.occlusion import occlusion_order
    from meshslam.geometry.parked_map import ParkedMap, ParkedRules, parked_rows
    from meshslam.geometry.pose import Pose, QuaternionOrder, nearest_rotation
    from meshslam.geometry.quaternions import quaternions_of_rotations, rotations_of_quaternions
    from meshslam.geometry.rendering import Outline, Rendering, coverage, outline, render
    from meshslam.geometry.road_texture import RoadTexture
    from meshslam.geometry.robust import geman_mcclure, geman_mcclure_soft
    from meshslam.geometry.shapes import cotangent_weights, mask_iou, voxel_iou
    from meshslam.geometry.tracked_points import NormalEquations, TrackedPoints
    from meshslam.geometry.triangulation import kabsch, triangulate
else:
    __getattr__ = deferred(
        __name__,
        {
            "arrays": "AnyArray Bools Bytes Floats Ints Singles",
            "assignment": "best_pairs",
            "batched_losses": (
                "Cameras Intrinsics Reals ViewLosses batched_keypoint_loss batched_mask_loss "
                "batched_silhouette_gradients batched_silhouettes intrinsics_of reals summed_over_views"
            ),
            "block_system": "BlockSystem LinearFactor Solution VariableGroup Variables linear_cost",
            "camera": "Camera",
            "gltf_check": "check_gltf is_gltf",
            "lie": "cross_matrix exp_so3 hat log_so3 right_jacobian right_jacobian_inverse",
            "mask_iou_loss": "MaskGradient MaskLoss kato_pixel_gradient mask_gradients",
            "object_model": "Block GroundPlane Iteration NoiseModel ObjectModel ObjectState Refined SquareRoot View",
            "observation": (
                "PixelDerivatives camera_points keypoint_loss keypoint_loss_gradient keypoint_pixels mask_loss "
                "mask_loss_gradient mesh_masks pixel_derivatives projection_derivative selection"
            ),
            "occlusion": "occlusion_order",
            "parked_map": "ParkedMap ParkedRules parked_rows",
            "pose": "Pose QuaternionOrder nearest_rotation",
            "quaternions": "quaternions_of_rotations rotations_of_quaternions",
            "rendering": "Outline Rendering coverage outline render",
            "robust": "geman_mcclure geman_mcclure_soft",
            "road_texture": "RoadTexture",
            "shapes": "cotangent_weights mask_iou voxel_iou",
            "tracked_points": "NormalEquations TrackedPoints",
            "triangulation": "kabsch triangulate",
        },
    )

__all__ = [
    "AnyArray",
    "Block",
    "BlockSystem",
    "Bools",
    "Bytes",
    "Camera",
    "Cameras",
    "Floats",
    "GroundPlane",
    "Intrinsics",
    "Ints",
    "Iteration",
    "LinearFactor",
    "MaskGradient",
    "MaskLoss",
    "NoiseModel",
    "NormalEquations",
    "ObjectModel",
    "ObjectState",
    "Outline",
    "ParkedMap",
    "ParkedRules",
    "PixelDerivatives",
    "Pose",
    "QuaternionOrder",
    "Reals",
    "Refined",
    "Rendering",
    "RoadTexture",
    "Singles",
    "Solution",
    "SquareRoot",
    "TrackedPoints",
    "VariableGroup",
    "Variables",
    "View",
    "ViewLosses",
    "batched_keypoint_loss",
    "batched_mask_loss",
    "batched_silhouette_gradients",
    "batched_silhouettes",
    "best_pairs",
    "camera_points",
    "check_gltf",
    "cotangent_weights",
    "coverage",
    "cross_matrix",
    "exp_so3",
    "geman_mcclure",
    "geman_mcclure_soft",
    "hat",
    "intrinsics_of",
    "is_gltf",
    "kabsch",
    "kato_pixel_gradient",
    "keypoint_loss",
    "keypoint_loss_gradient",
    "keypoint_pixels",
    "linear_cost",
    "log_so3",
    "mask_gradients",
    "mask_iou",
    "mask_loss",
    "mask_loss_gradient",
    "mesh_masks",
    "nearest_rotation",
    "occlusion_order",
    "outline",
    "parked_rows",
    "pixel_derivatives",
    "projection_derivative",
    "quaternions_of_rotations",
    "reals",
    "render",
    "right_jacobian",
    "right_jacobian_inverse",
    "rotations_of_quaternions",
    "selection",
    "summed_over_views",
    "triangulate",
    "voxel_iou",
]
