"""The protocols that a run is measured by, each under its name, with its source, and what it needs."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from meshslam.errors import ConfigError
from meshslam.evaluation.material import Material, UnavailableError
from meshslam.evaluation.path_pairs import positions, umeyama
from meshslam.evaluation.trajectories import (
    absolute_errors_m,
    absolute_rotation_errors_rad,
    end_error,
    frame_pairs,
    metre_pairs,
    relative_errors,
    root_mean_square,
)
from meshslam.geometry import Floats
from meshslam.sequences import Progress, no_progress

Group = Literal["trajectory", "objects", "tracks", "calibration", "masks"]
Figures = dict[str, float]


@dataclass(frozen=True, eq=False)
class Protocol:
    """One way to measure a run. `figures` raises UnavailableError, with the reason, where the files do not allow it."""

    name: str
    group: Group
    title: str
    source: str  # paper or development kit
    figures: Callable[[Material, Progress], Figures]


@dataclass(frozen=True)
class Measured:
    """What a protocol found: its figures, or why it found none."""

    protocol: str
    group: Group
    source: str
    figures: dict[str, float]
    reason: str | None = None


def ate(material: Material, progress: Progress = no_progress) -> Figures:
    """Errors of the camera's position as the paths are, without alignment; metrics.json has the first and last."""
    pair = material.pair()
    errors = absolute_errors_m(pair)
    return {
        "ate_rmse_m": root_mean_square(errors),
        "ate_mean_m": float(errors.mean()),
        "ate_median_m": float(np.median(errors)),
        "ate_max_m": float(errors.max()),
        "ate_rotation_rmse_deg": float(np.degrees(root_mean_square(absolute_rotation_errors_rad(pair)))),
        **end_error(pair),
    }


def ate_se3(material: Material, progress: Progress = no_progress) -> Figures:
    """The same with the estimate laid on the truth by a rotation and a translation.

    Rotations are left out: positions along a nearly straight path leave the roll about it free.
    """
    errors = absolute_errors_m(material.pair().aligned())
    return {
        "ate_se3_rmse_m": root_mean_square(errors),
        "ate_se3_mean_m": float(errors.mean()),
        "ate_se3_max_m": float(errors.max()),
    }


def ate_sim3(material: Material, progress: Progress = no_progress) -> Figures:
    """The same with a scale; `ate_sim3_scale` is what the estimate is multiplied by."""
    pair = material.pair()
    errors = absolute_errors_m(pair.aligned(with_scale=True))
    scale = umeyama(positions(pair.truth), positions(pair.estimate), with_scale=True).scale
    return {"ate_sim3_rmse_m": root_mean_square(errors), "ate_sim3_max_m": float(errors.max()), "ate_sim3_scale": scale}


def rpe_frames(material: Material, progress: Progress = no_progress) -> Figures:
    """Errors of the motion over a number of frames, every pair."""
    pair, delta = material.pair(), material.options.rpe_frames
    if len(pair) <= delta:
        raise UnavailableError(f"{len(pair)} poses have a partner, RPE over {delta} frames needs {delta + 1}")
    return _relative("rpe_frames", *relative_errors(pair, *frame_pairs(len(pair), delta)))


def rpe_metres(material: Material, progress: Progress = no_progress) -> Figures:
    """Errors of the motion over a distance along the true path, every pair."""
    pair, delta = material.pair(), material.options.rpe_metres
    first, last = metre_pairs(positions(pair.truth), delta)
    if not len(first):
        raise UnavailableError(f"no two true poses are {delta:g} m (to 10%) of the path apart")
    return _relative("rpe_metres", *relative_errors(pair, first, last))


def _relative(name: str, metres: Floats, radians: Floats) -> Figures:
    return {
        f"{name}_translation_rmse_m": root_mean_square(metres),
        f"{name}_translation_mean_m": float(metres.mean()),
        f"{name}_rotation_rmse_deg": float(np.degrees(root_mean_square(radians))),
        f"{name}_rotation_mean_deg": float(np.degrees(radians.mean())),
    }


def kitti_odometry(material: Material, progress: Progress = no_progress) -> Figures:
    """KITTI's t_rel and r_rel."""
    from meshslam.evaluation.kitti_odometry import LENGTHS_M, kitti_odometry_figures
    from meshslam.evaluation.path_pairs import path_length_m

    pair = material.pair()
    figures = kitti_odometry_figures(pair)
    if not figures:
        length_m = path_length_m(positions(pair.truth))
        raise UnavailableError(f"the true path is {length_m:.1f} m long, segments are {LENGTHS_M[0]} m and longer")
    return figures


def voxel_iou(material: Material, progress: Progress = no_progress) -> Figures:
    """Overlap of the meshes' volumes on a grid of 5 cm; a missed object has IoU 0."""
    return material.object_scores(progress).shape_figures()


def centre_yaw(material: Material, progress: Progress = no_progress) -> Figures:
    """Which objects were found, and how far off they stand."""
    scores = material.object_scores(progress)
    return scores.place_figures() | scores.count_figures()


def chamfer(material: Material, progress: Progress = no_progress) -> Figures:
    """Mean distance of the surfaces of matched objects."""
    found = [d.chamfer_m for d in material.surfaces(progress)]
    if not found:
        raise UnavailableError("no true object has an estimate within 3 m")
    return {"chamfer_mean_m": float(np.mean(found)), "chamfer_median_m": float(np.median(found))}


def f_score(material: Material, progress: Progress = no_progress) -> Figures:
    """F-score of the surfaces at 5 cm; a missed object has 0."""
    found = [d.f_score() for d in material.surfaces(progress)]
    missed = material.object_scores(progress).missed
    return {"f_score_5cm_mean": float(sum(found) / (len(found) + missed))}


def a3dp(material: Material, progress: Progress = no_progress) -> Figures:
    """ApolloCar3D's A3DP-Abs and A3DP-Rel, over the run's frames."""
    from meshslam.evaluation.a3dp import a3dp_figures

    return a3dp_figures(material.seen(), progress)


def kitti_ap(material: Material, progress: Progress = no_progress) -> Figures:
    """KITTI's BEV and 3-D AP with 40 recall points, over the run's frames."""
    from meshslam.evaluation.kitti_detection import kitti_detection_figures

    return kitti_detection_figures(material.seen())


def mota(material: Material, progress: Progress = no_progress) -> Figures:
    """CLEAR MOT's accuracy."""
    from meshslam.evaluation.tracks import mota_figures

    return mota_figures(material.tracks())


def idf1(material: Material, progress: Progress = no_progress) -> Figures:
    """F1 score of identities."""
    from meshslam.evaluation.tracks import idf1_figures

    return idf1_figures(material.tracks())


def hota(material: Material, progress: Progress = no_progress) -> Figures:
    """Higher order tracking accuracy, with its detection and association parts."""
    from meshslam.evaluation.tracks import hota_figures

    return hota_figures(material.tracks())


def calibration_objects(material: Material, progress: Progress = no_progress) -> Figures:
    """How many objects stand inside their position's 68% and 95% regions, and NEES."""
    from meshslam.evaluation.calibration import object_calibration

    figures = object_calibration(material.pairs()).figures("object_position")
    if not figures:
        raise UnavailableError("no matched object has a pose_covariance in map.json")
    return figures


def calibration_path(material: Material, progress: Progress = no_progress) -> Figures:
    """The same of the camera's poses."""
    from meshslam.evaluation.calibration import path_calibration

    found = path_calibration(material.true_path(), material.estimate(), material.options.max_difference_s)
    figures: Figures = {}
    for name, part in found.items():
        figures |= part.figures(name)
    if not figures:
        raise UnavailableError("no pose with a covariance has a true pose of its time")
    return figures


def mask_iou(material: Material, progress: Progress = no_progress) -> Figures:
    """Drawn meshes against the run's own masks; needs no truth."""
    from meshslam.evaluation.masks import score_masks

    figures = score_masks(material.mask_folder(), progress=progress, scene=material.map, path=material.path).figures()
    if not figures:
        raise UnavailableError("no detection of a car is 40 px wide")
    return figures


_STURM = "Sturm et al., A Benchmark for the Evaluation of RGB-D SLAM Systems, IROS 2012"
_KITTI_SEGMENTS = "Geiger et al., CVPR 2012; KITTI odometry devkit, evaluate_odometry.cpp"
PROTOCOLS: dict[str, Protocol] = {
    p.name: p
    for p in (
        Protocol("ate", "trajectory", "Absolute trajectory error", f"{_STURM}; no alignment", ate),
        Protocol("ate-se3", "trajectory", "ATE, aligned", f"{_STURM}; SE(3) by Umeyama, TPAMI 1991", ate_se3),
        Protocol("ate-sim3", "trajectory", "ATE, aligned and scaled", f"{_STURM}; Sim(3) by Umeyama 1991", ate_sim3),
        Protocol("rpe-frames", "trajectory", "Relative pose error over frames", _STURM, rpe_frames),
        Protocol(
            "rpe-metres", "trajectory", "Relative pose error over metres", f"{_STURM}; pairs as in evo", rpe_metres
        ),
        Protocol("kitti-odometry", "trajectory", "KITTI t_rel, r_rel", _KITTI_SEGMENTS, kitti_odometry),
        Protocol("voxel-iou", "objects", "Voxel IoU", "grid of 5 cm in the true object's frame", voxel_iou),
        Protocol("centre-yaw", "objects", "Centre and yaw", "one-to-one matches within 3 m", centre_yaw),
        Protocol("chamfer", "objects", "Chamfer distance", "Mescheder et al., CVPR 2019 (Chamfer-L1)", chamfer),
        Protocol("f-score", "objects", "F-score at 5 cm", "Knapitsch et al., TOG 2017", f_score),
        Protocol("a3dp", "objects", "A3DP-Abs, A3DP-Rel", "Song et al., ApolloCar3D, CVPR 2019", a3dp),
        Protocol(
            "kitti-ap", "objects", "KITTI BEV and 3-D AP", "Geiger et al. 2012; Simonelli et al., ICCV 2019", kitti_ap
        ),
        Protocol("mota", "tracks", "MOTA", "Bernardin and Stiefelhagen, EURASIP JIVP 2008", mota),
        Protocol("idf1", "tracks", "IDF1", "Ristani et al., ECCV Workshops 2016", idf1),
        Protocol("hota", "tracks", "HOTA", "Luiten et al., IJCV 2021", hota),
        Protocol(
            "calibration-objects", "calibration", "Objects' positions", "Bar-Shalom et al. 2001", calibration_objects
        ),
        Protocol("calibration-path", "calibration", "Camera's poses", "Bar-Shalom et al. 2001", calibration_path),
        Protocol("mask-iou", "masks", "Mask IoU", "Feng et al., IROS 2019, Table I", mask_iou),
    )
}


def chosen_protocols(names: Iterable[str]) -> list[Protocol]:
    """The protocols, in their order, that names or groups say; all where none is said. ConfigError for another name."""
    wanted = list(names)
    groups = {p.group for p in PROTOCOLS.values()}
    for name in wanted:
        if name not in PROTOCOLS and name not in groups:
            known = ", ".join([*PROTOCOLS, *sorted(groups)])
            raise ConfigError(f"--protocol {name}: there is no such protocol or group: choose of {known}")
    return [p for p in PROTOCOLS.values() if not wanted or p.name in wanted or p.group in wanted]


def measure(material: Material, names: Iterable[str] = (), progress: Progress = no_progress) -> list[Measured]:
    """Each protocol's figures, or the reason why there are none; ConfigError for a name that is no protocol.

    Example:
        [row.figures for row in measure(material, ["ate-se3", "objects"])]

    """
    rows = []
    for protocol in chosen_protocols(names):
        figures, reason = {}, None
        try:
            figures = protocol.figures(material, progress)
        except UnavailableError as error:
            reason = str(error)
        rows.append(Measured(protocol.name, protocol.group, protocol.source, figures, reason))
    return rows
