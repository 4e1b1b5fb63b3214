"""One object from its observations: start, pose, shape, uncertainty."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.objects.config import GradientConfig, ObjectConfig
    from meshslam.objects.gradient_descent import reconstruct_by_gradient
    from meshslam.objects.ground import road_points
    from meshslam.objects.heading import heading_cost, reversed_probability
    from meshslam.objects.models import category_model
    from meshslam.objects.noise import estimated_noise
    from meshslam.objects.observations import keypoints_of, make_view, signed_distance, view_bytes
    from meshslam.objects.occlusion import FrameOcclusion, Occluders, Placed
    from meshslam.objects.reconstruction import (
        Reconstruction,
        Scene,
        TrackObservations,
        centred,
        cheapest,
        fit_free_form,
        fit_modes,
        height_over_road_m,
        motion,
        reconstruct,
        refit,
        uncertainty,
        with_surface_error,
        with_surface_sigmas,
    )
    from meshslam.objects.saved_views import views_from_arrays, views_to_arrays
    from meshslam.objects.start_search import flipped
    from meshslam.objects.track import Track, choose_views, is_cut, make_views
else:
    __getattr__ = deferred(
        __name__,
        {
            "config": "GradientConfig ObjectConfig",
            "gradient_descent": "reconstruct_by_gradient",
            "ground": "road_points",
            "heading": "heading_cost reversed_probability",
            "models": "category_model",
            "noise": "estimated_noise",
            "observations": "keypoints_of make_view signed_distance view_bytes",
            "occlusion": "FrameOcclusion Occluders Placed",
            "reconstruction": (
                "Reconstruction Scene TrackObservations centred cheapest fit_free_form fit_modes "
                "height_over_road_m motion reconstruct refit uncertainty with_surface_error "
                "with_surface_sigmas"
            ),
            "saved_views": "views_from_arrays views_to_arrays",
            "start_search": "flipped",
            "track": "Track choose_views is_cut make_views",
        },
    )

__all__ = [
    "FrameOcclusion",
    "GradientConfig",
    "ObjectConfig",
    "Occluders",
    "Placed",
    "Reconstruction",
    "Scene",
    "Track",
    "TrackObservations",
    "category_model",
    "centred",
    "cheapest",
    "choose_views",
    "estimated_noise",
    "fit_free_form",
    "fit_modes",
    "flipped",
    "heading_cost",
    "height_over_road_m",
    "is_cut",
    "keypoints_of",
    "make_view",
    "make_views",
    "motion",
    "reconstruct",
    "reconstruct_by_gradient",
    "refit",
    "reversed_probability",
    "road_points",
    "signed_distance",
    "uncertainty",
    "view_bytes",
    "views_from_arrays",
    "views_to_arrays",
    "with_surface_error",
    "with_surface_sigmas",
]
