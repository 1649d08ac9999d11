"""Slips of images: against a test of residuals written out, and against the plain chain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from reference_chain import run
from scenes import cube8_system, random_system, read_only, system_of, with_unseen
from tailstack import score
from tailstack.estimation.resection import project
from tailstack.results import SlipReliability


def residual_square(slopes, noise, left_out=()):
    """Sum of squares of what eleven free parameters leave of noise (2N, M), in px, without some of the images."""
    rows = [k for k in range(len(noise)) if k // 2 not in left_out]
    basis = np.linalg.qr(np.linalg.svd(slopes[rows], full_matrices=False)[0][:, :11])[0]
    rest = noise[rows] - basis @ (basis.T @ noise[rows])
    return (rest**2).sum(axis=0)


def slopes_of(projection, points):
    """(2N, 12) by differences of the plain projection."""
    columns = []
    for k in range(12):
        step = np.zeros(12)
        step[k] = 1e-6 * np.abs(projection).ravel()[k] or 1e-6
        ahead, behind = (project(projection + sign * step.reshape(3, 4), points) for sign in (1, -1))
        columns.append(((ahead - behind) / (2 * step[k])).ravel())
    stacked = np.array(columns).T
    return stacked / np.linalg.norm(stacked, axis=0)


def found_for(system, view, label) -> SlipReliability:
    entries = score(system, reliability=True, losses=False).reliability
    return next(entry for entry in entries if (entry.view, entry.fiducial) == (view, label))


def test_a_slip_of_that_size_is_noticed_in_80_of_100_cases():
    """sampled: leaving a bead out lowers the sum of squares by a chi-square of two; 0.80 within 4 standard errors."""
    rng = np.random.default_rng(4)
    system = cube8_system()
    view = system.views[0]
    found = found_for(system, view.name, "F3")
    slopes = slopes_of(view.projection, system.fiducials_mm)

    def power(slip):
        noise = rng.normal(size=(16, 20_000)) * view.fiducial_noise_px
        noise[4:6] += slip[:, None]
        drop = residual_square(slopes, noise) - residual_square(slopes, noise, (2,))
        return float((drop / view.fiducial_noise_px**2 > chi2.isf(0.001, 2)).mean())

    powers = [power(found.slip_px * np.array([np.cos(a), np.sin(a)])) for a in np.linspace(0, np.pi, 60)]
    assert min(powers) == pytest.approx(0.80, abs=4 * np.sqrt(0.16 / 20_000) + 0.005)


def test_what_an_unnoticed_slip_does_is_what_it_does_in_the_chain():
    """independent: slips of every direction that are just noticed, through the plain chain of SVDs."""
    system = random_system(np.random.default_rng(2), fiducials=9)
    system = replace(system, manufacturing_half_width_mm=read_only(np.zeros((9, 3))))
    view = system.views[1]
    found = found_for(system, view.name, "F5")
    slopes = slopes_of(view.projection @ np.eye(4), system.fiducials_mm)
    still = run(system, system.targets[0], {})["tcp"]
    largest = 0.0
    for angle in np.linspace(0, np.pi, 180, endpoint=False):
        direction = np.zeros((18, 1))
        direction[8:10, 0] = np.cos(angle), np.sin(angle)
        told = (residual_square(slopes, direction) - residual_square(slopes, direction, (4,)))[0]
        size = np.sqrt(19.7874 / told) * view.fiducial_noise_px
        moved = run(system, system.targets[0], {f"fiducial_noise:{view.name}": 1e-2 * size * direction[:, 0]})["tcp"]
        largest = max(largest, float(np.linalg.norm(moved - still)) / 1e-2)
    assert found.effect_mm == pytest.approx(largest, rel=5e-3)  # the structure sits a little off the nominal place


def test_with_six_beads_nothing_is_ever_noticed_in_some_direction():
    """closed form: twelve coordinates less eleven unknowns leave one number to test."""
    rng = np.random.default_rng(8)
    system = system_of(rng.uniform(-50, 50, (6, 3)) + np.array([0, 0, -20.0]))
    entries = score(system, reliability=True).reliability
    assert len(entries) == 12
    assert all(entry.slip_px is None and entry.effect_mm is None for entry in entries)
    some = score(with_unseen(cube8_system(), 0, ("F1",)), reliability=True).reliability
    assert len(some) == 15
    assert score(system).reliability == ()
