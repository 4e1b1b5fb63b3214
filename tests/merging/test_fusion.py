"""One estimate of several: weighted by information, the prior counted once."""

from dataclasses import replace

import numpy as np

from meshslam.merging.fusion import fused_vertices


def things(drive_by, street, count=2):
    drives = [drive_by(f"d{k}", street(1, 1), k)[0] for k in range(count)]
    return [drive.map.objects[0] for drive in drives]


def test_vertices_are_weighted_by_their_information(street, drive_by):
    one, other = things(drive_by, street)
    one, other = (replace(o, vertex_sigma_m=np.full(len(o.vertices), s)) for o, s in ((one, 0.01), (other, 0.03)))
    vertices, sigma, observed = fused_vertices([one, other])
    assert np.abs(vertices - (0.9 * one.vertices + 0.1 * other.vertices)).max() < 1e-12
    assert np.abs(sigma - (1e4 + 1e4 / 9) ** -0.5).max() < 1e-12
    assert observed.all()


def test_the_prior_of_what_no_drive_saw_counts_once(street, drive_by):
    one, other = things(drive_by, street)
    half = np.arange(len(one.vertices)) % 2 == 0
    none = np.zeros(len(half), bool)
    vertices, sigma, observed = fused_vertices(
        [replace(one, vertex_observed=half), replace(other, vertex_observed=none)]
    )
    assert np.abs(vertices[half] - one.vertices[half]).max() < 1e-12  # what one saw is its alone
    assert np.allclose(sigma, 0.03)  # two priors are not two measurements
    assert (observed == half).all()
