"""What the cars of one drive have in common: their mean shape may differ from the category's.

A shape is z = mu + e, e ~ N(0, I), with the drive's mu ~ N(0, sigma^2 I). An object's data of information J give, with
mu = 0, the estimate z_i and its covariance P_i = (J + I)^-1. What the data alone say of mu has the precision
W_i = (J^-1 + I)^-1 = I - P_i, and W_i times their own answer is z_i. So
mu = (sum_i (I - P_i) + I / sigma^2)^-1 sum_i z_i. An object that shows little of its shape counts little, and its own
shape gets the prior N(mu, I) then (Gelman et al., Bayesian Data Analysis, 2013, ch. 5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry import Floats, ObjectState
from meshslam.mapping.work import Work
from meshslam.moving import ShapeEvidence
from meshslam.objects import Reconstruction, Scene, category_model


def shape_evidence(work: Work, scene: Scene) -> ShapeEvidence | None:
    """The modes without free form of an object whose views are there; None where nothing holds a parameter."""
    found, views = work.found, work.observed.views
    try:
        covariance = scene.model.covariance(
            views, found.ground, scene.config.noise, found.modes, ["modes"], modes=True, free_form=False
        )
    except GeometryError:
        return None
    return ShapeEvidence(found.modes.z, covariance)


def common_shape(evidence: Sequence[ShapeEvidence], sigma: float) -> Floats | None:
    """The drive's mu (M,), in standard deviations of the modes; None without evidence or where sigma is 0."""
    if not evidence or sigma == 0:
        return None
    unit = np.eye(len(evidence[0].z))
    precision = unit / sigma**2 + sum(unit - one.covariance for one in evidence)
    found: Floats = np.linalg.solve(precision, np.sum([one.z for one in evidence], axis=0))
    return np.round(found, 9)  # its last bits vary with memory's alignment


def scene_about(scene: Scene, mu: Floats) -> Scene:
    """The same scene with its shapes counted from another mean."""
    category = replace(scene.category, vertices=scene.category.shape(mu))
    return replace(scene, category=category, model=category_model(category))


def about(work: Work, mu: Floats) -> Work:
    """The same object, its shapes counted from another mean."""

    def moved(state: ObjectState) -> ObjectState:
        return replace(state, z=state.z - mu)

    found = work.found
    return replace(
        work,
        found=Reconstruction(
            moved(found.start), moved(found.posed), moved(found.modes), moved(found.state), found.ground, found.cost
        ),
    )
