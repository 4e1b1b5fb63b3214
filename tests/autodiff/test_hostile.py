"""Hostile input to the core and to both frameworks; `make fuzz` goes on for longer."""

import os

import numpy as np
import pytest

from meshslam.errors import GeometryError
from meshslam.geometry import (
    batched_keypoint_loss,
    batched_mask_loss,
    batched_silhouette_gradients,
    batched_silhouettes,
)
from tests.autodiff.frameworks import FRAMEWORKS
from tests.autodiff.hostile import Case, case

CASES = int(os.environ.get("MESHSLAM_MUTATIONS", "300"))
FIRST = int(os.environ.get("MESHSLAM_FUZZ_SEED", "0")) * 1_000_000


def tame(given: Case) -> bool:
    """Nothing that numbers run over with."""
    with np.errstate(all="ignore"):
        return all(np.abs(a).max(initial=0) < 1e6 for a in (given.vertices, given.pose, given.slopes, given.pixels))


def calls(given: Case):
    """Each entry point of the core."""
    v, f, p, c = given.vertices, given.faces, given.pose, given.camera
    yield lambda: vars(batched_mask_loss(v, f, p, c, given.masks, gradient=given.gradient, threads=2)).values()
    yield lambda: [batched_silhouettes(v, f, p, c)]
    yield lambda: batched_silhouette_gradients(v, f, p, c, given.slopes)
    yield lambda: vars(batched_keypoint_loss(v, given.association, p, c, given.pixels, given.visible)).values()


def test_the_core_gives_numbers_or_a_clear_error():
    computed = 0
    for seed in range(FIRST, FIRST + CASES):
        given = case(seed)
        for number, call in enumerate(calls(given)):
            try:
                with np.errstate(all="ignore"):
                    found = call()
            except GeometryError as error:
                assert len(str(error)) > 10, seed  # noqa: PT017 # most cases raise none
                continue
            computed += 1
            if tame(given):
                assert not any(np.isnan(array).any() for array in found), f"seed {seed}, call {number}"
    assert computed > CASES  # most of them are sound


@pytest.mark.parametrize("name", FRAMEWORKS)
def test_frameworks_give_numbers_or_a_clear_error(name):
    framework = FRAMEWORKS[name]()
    computed = 0
    for seed in range(FIRST, FIRST + CASES // 30):
        given = case(seed)
        if given.vertices.dtype.kind != "f" or given.pose.dtype.kind != "f":
            continue  # frameworks differentiate floats

        def loss(v, p, given=given):
            a = framework.array
            masks, options = a(given.masks), {"gradient": given.gradient}
            return framework.losses.mask_iou_loss(v, a(given.faces), p, given.camera, masks, **options).sum()

        def drawn(v, p, given=given):
            return framework.losses.silhouettes(v, framework.array(given.faces), p, given.camera).sum()

        for function in (loss, drawn):
            try:
                found = framework.gradients(function, given.vertices, given.pose)
            except (GeometryError, RuntimeError) as error:  # JAX wraps the core's words
                assert str(error)  # noqa: PT017
                continue
            computed += 1
            if tame(given):
                assert not any(np.isnan(array).any() for array in found), seed
    assert computed > CASES // 100
