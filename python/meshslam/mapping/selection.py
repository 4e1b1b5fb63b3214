"""Which tracks are worth an object."""

from __future__ import annotations

from collections.abc import Iterable

from meshslam.mapping.config import MappingConfig
from meshslam.mapping.left_out import LeftOut
from meshslam.maps import CameraPath
from meshslam.objects import Track
from meshslam.perception import Detection, DetectionSet, voted_category


def usable_tracks(
    frames: CameraPath, detections: DetectionSet, category: str, config: MappingConfig, min_view_box_px: float
) -> tuple[list[Track], list[LeftOut]]:
    """Tracks of the category with enough views of enough size, and the others with the reason."""
    at = {frame: i for i, frame in enumerate(frames.frame_ids)}
    needed = min(config.min_views, len(frames.frame_ids))
    tracks, left_out = [], []
    for number, found in detections.by_track().items():
        kind = voted_category(found)
        seen = _one_a_frame([d for d in found if d.frame in at])
        widest = max((d.bbox[2] for d in seen), default=0.0)
        views = sum(d.bbox[2] >= min_view_box_px for d in seen)
        if kind != category:
            left_out.append(LeftOut(number, "other category", f"most of its detections say {kind}"))
        elif widest < config.min_box_px:
            left_out.append(LeftOut(number, "too small", f"at most {widest:.0f} px wide"))
        elif views < needed:
            wide = f"at least {min_view_box_px:.0f} px wide"
            left_out.append(LeftOut(number, "too few views", f"{views} {wide} of {needed} needed"))
        else:
            index = [at[d.frame] for d in seen]
            poses = tuple(frames.world_from_camera[i] for i in index)
            tracks.append(Track(number, tuple(seen), poses, frames.times_s[index]))
    return tracks, left_out


def _one_a_frame(found: Iterable[Detection]) -> list[Detection]:
    """The largest detection of each frame, by frame."""
    best: dict[int, Detection] = {}
    for d in found:
        if d.frame not in best or d.area_px > best[d.frame].area_px:
            best[d.frame] = d
    return [best[frame] for frame in sorted(best)]
