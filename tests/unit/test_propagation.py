"""First order against finite differences of the plain chain, closed forms, and the reference cases."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from reference_chain import run
from scenes import (
    cube8_system,
    cube_fiducials,
    mount,
    random_system,
    read_only,
    system_of,
    target,
    with_noise,
    with_systematic,
    with_unseen,
)
from tailstack.geometry.rotation import RotationForm, rotation_xyz
from tailstack.propagation.linear import (
    chain_of,
    covariance,
    covariance_block_diagonal,
    eq16_manufacturing,
    estimation_of,
    linearise,
)
from tailstack.propagation.noise import assemble, eliminate_for, gains_after, gains_of_images, room_for, room_for_gains
from tailstack.system import LINEAR, Estimator, Reading, Triangulation, View

ORACLES = Path(__file__).parents[1] / "data" / "oracles"


def oracle(name):
    return json.loads((ORACLES / name).read_text())


SEEN = [(2, (), False), (3, (), False), (2, (("F2", "F5"), ("F9",)), False), (2, (), True), (2, (("F2",),), True)]


# Each two of reading, form and what is seen are met together
@pytest.mark.parametrize(
    ("views", "unseen", "systematic", "reading", "form"),
    [
        pytest.param(*seen, reading, form, marks=pytest.mark.long if (k + i + j) % 2 else [])
        for k, seen in enumerate(SEEN)
        for i, reading in enumerate(Reading)
        for j, form in enumerate(RotationForm)
    ],
)
def test_every_gain_equals_the_finite_difference_of_the_chain(views, unseen, systematic, reading, form):
    """independent: central differences of the SVD chain, Richardson's step pair for O(h^4)."""
    system = random_system(np.random.default_rng(7 + views), fiducials=9, views=views, reading=reading)
    system = replace(system, rotation_form=form)
    for v, missing in enumerate(unseen):
        system = with_unseen(system, v, missing)
    if systematic:
        system = with_systematic(system)
    aim = system.targets[0]
    model = linearise(system, aim)
    unperturbed = run(system, aim, {})
    assert np.allclose(unperturbed["tcp"], model.bias_mm("tcp"), rtol=0, atol=1e-8)
    assert np.allclose(unperturbed["localisation"], model.bias_mm("localisation"), rtol=0, atol=1e-8)
    for block in model.blocks:
        for j, unit in enumerate(block.units):
            step = {"rad": 1e-3, "mm": 3e-2, "px": 3e-2, "N": 1.0, "K": 10.0}[unit]
            kick = np.eye(len(block.units))[j]

            def slope(h, kick=kick, name=block.contributor):
                ahead, behind = (run(system, aim, {name: s * h * kick}) for s in (1, -1))
                return {k: (ahead[k] - behind[k]) / (2 * h) for k in ahead}

            near, far = slope(step), slope(2 * step)
            for error, gain in block.gains.items():
                numeric = (4 * near[error] - far[error]) / 3
                scale = 1 + np.abs(gain).max()
                assert np.allclose(numeric, gain[:, j], rtol=0, atol=3e-7 * scale), (block.contributor, j, error)


def test_known_shifts_are_those_of_the_chain():
    """independent: the chain with and without the known temperature and the balls; second order is 1e-3 of them."""
    system = with_systematic(random_system(np.random.default_rng(5), fiducials=9), known=True)
    aim = system.targets[0]
    plain = replace(system, effects=tuple(e for e in system.effects if not e.known.any()))
    model, without = linearise(system, aim), run(plain, aim, {})
    assert [each.contributor for each in model.known] == ["temperature", "ball_images"]
    for error in ("tcp", "localisation"):
        shift = run(system, aim, {})[error] - without[error]
        assert np.linalg.norm(shift) > 0.02
        close = 2e-3 * float(np.linalg.norm(shift))
        np.testing.assert_allclose(model.bias_mm(error) - without[error], shift, rtol=0, atol=close)
        known = np.sum([each.of(error) for each in model.known], axis=0)
        np.testing.assert_allclose(known, shift, rtol=0, atol=close)


def test_noise_covariance_of_the_reference_cube():
    """oracle: implicit differentiation checked by 50-digit finite differences."""
    case = oracle("noise_covariance_cube8.json")
    views = views_of(case, case["sigma_px"], case["sigma_px"])
    system = system_of(case["fiducials"], views=views, targets=(target(case["target"]),))
    got = covariance(linearise(system, system.targets[0]), "localisation")
    assert np.allclose(got, case["Sigma"], rtol=0, atol=case["tol_Sigma_rel"] * np.abs(case["Sigma"]).max())


def views_of(case, fiducial_px, target_px):
    """Views by the projections of an oracle."""
    scaled = [np.array(matrix) / np.linalg.norm(matrix[2][:3]) for matrix in case["P"]]
    return tuple(View(f"v{k}", read_only(each), fiducial_px, target_px, None) for k, each in enumerate(scaled))


def test_shared_fiducial_errors_keep_their_cross_view_covariance():
    """oracle: with it, and the block-diagonal value of Eq 16 without it."""
    case = oracle("fiducial_manufacturing.json")
    spread = np.full((8, 3), case["sigma_mfg_mm"])
    system = cube8_system(manufacturing_half_width_mm=read_only(spread))
    model = linearise(system, system.targets[0])
    tolerance = case["tol_rel"] * np.abs(case["Sigma"]).max()
    for error in ("localisation", "tcp"):
        assert np.allclose(covariance(model, error), case["Sigma"], rtol=0, atol=tolerance)
        wrong = covariance_block_diagonal(model, error)
        assert np.allclose(wrong, case["Sigma_wrong_blockdiag"], rtol=0, atol=tolerance)


def test_triangulation_alone_against_the_closed_form():
    """oracle: known projection matrices, isocentre and off-centre."""
    case = oracle("perfect_calibration_bound.json")
    views = views_of(case, 0.0, 0.5)
    for place, key in (("isocentre", "std_mm"), ("off_centre", "std_mm_depth_weighted_linear")):
        aim = target(case[place]["target"])
        system = system_of(cube_fiducials(), views=views, targets=(aim,))
        got = np.sqrt(np.diag(covariance(linearise(system, aim), "localisation")))
        assert np.allclose(got, case[place][key], rtol=case["tol_rel"])


@pytest.mark.long
def test_compiled_and_plain_source_give_the_same_digits():
    system = random_system(np.random.default_rng(3), fiducials=7)
    shifts = np.random.default_rng(4).normal(size=(2, 16, 3))
    for estimator, form in product(Estimator, Triangulation):
        system = replace(system, estimator=estimator, triangulation=form)
        given = chain_of(system).imaging, system.sees, system.targets[0].position_mm, shifts
        compiled = gains_of_images(*given)
        plain = [np.zeros_like(each) for each in compiled]
        assemble(*given, *plain)
        for one, other in zip(compiled, plain, strict=True):
            assert np.allclose(one, other, rtol=1e-8, atol=1e-11)


def test_what_eq16_drops_and_how_far_a_target_lies_are_those_of_sums_written_down():
    """Eq 16's covariance of manufacturing against the plain gains of each view, turned as the structure is."""
    rng = np.random.default_rng(9)
    system = random_system(rng, fiducials=7)
    projections, points = np.stack([v.projection for v in system.views]), system.fiducials_mm
    aim, per_error = system.targets[0].position_mm, rotation_xyz(rng.uniform(-1, 1, 3))
    plain = room_for_gains(points, np.zeros((2, 2, 2)))
    eliminated, seen, estimation = room_for(2, points), np.ones((2, 7)), estimation_of(system)
    eliminate_for(estimation, projections, points, seen, eliminated)
    gains_after(eliminated, projections, points, seen, estimation, aim, plain)
    chain, widths = chain_of(system), rng.uniform(0.01, 0.1, (7, 3))
    imaging = chain.imaging._replace(projections=projections, points=points, per_error=per_error, manufactured=True)
    gains, _ = gains_of_images(imaging, system.sees, aim, np.zeros((2, 16, 0)))
    told = replace(chain, imaging=imaging, system=replace(system, manufacturing_half_width_mm=widths))
    scaled = (plain[2] @ per_error) * told.system.manufacturing_std_mm[None, :, None, :]
    expected = np.einsum("vijk,vilk->jl", scaled, scaled)
    np.testing.assert_allclose(eq16_manufacturing(told, gains), expected, rtol=1e-9)
    radius = np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean())
    model = linearise(system, system.targets[0])
    away = np.linalg.norm(model.reconstructed_mm - points.mean(axis=0))
    assert model.extrapolation == pytest.approx(away / radius, rel=1e-12)


@pytest.mark.long
def test_points_that_determine_nothing_have_gains_that_are_not_finite():
    system = random_system(np.random.default_rng(3), fiducials=7)
    projections = np.stack([v.projection for v in system.views])
    flat = system.fiducials_mm * [1.0, 1.0, 0.0]
    imaging = chain_of(system).imaging._replace(projections=projections, points=flat, manufactured=False)
    gains, _ = gains_of_images(imaging, system.sees, system.targets[0].position_mm, np.zeros((2, 16, 0)))
    assert not np.isfinite(gains).all()


@pytest.mark.parametrize("form", list(LINEAR))
def test_without_noise_the_bias_is_exact_for_every_layout(form):
    """oracle and closed form: q_hat = T^-1 q (physical), T q (Eq 18), whatever the layout."""
    case = oracle("rigid_bias_exact.json")
    bias = [*np.deg2rad([1, -0.5, 2]), 2, -1, 3]
    first = mount("structure_connector", (0, 0, -95), bias=bias)
    for reading, key in ((Reading.PHYSICAL, "qhat_physical"), (Reading.EQ18, "qhat_eq18")):
        system = cube8_system(structure_connector=first, reading=reading, triangulation=form, views=with_noise(0.5))
        model = linearise(system, system.targets[0])
        assert np.allclose(model.reconstructed_mm, case[key], rtol=0, atol=case["tol_mm"])
        located = run(system, system.targets[0], {})["localisation"] + system.targets[0].position_mm
        assert np.allclose(located, case[key], rtol=0, atol=case["tol_mm"])
