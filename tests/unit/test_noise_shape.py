"""Image noise that is not alike in all directions: who weighs by it, and who does not; what is no covariance.  Against
a chain drawn in NumPy: test_correlation.py."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2
from test_correlation import STILL, document_of, rows_of
from test_design_function import difference_by

from plain_data import DEMO, problems_of, read_cases
from tailstack import DesignFunction, load_design, score, score_batch, verify
from tailstack.design import Design, compile_design
from tailstack.estimation.least_squares import weights_at_rest
from tailstack.propagation.linear import linearise

SHAPES = {"fiducial_noise_shape": [[1.8, 0.45], [0.45, 0.2]], "target_noise_shape": [[0.3, -0.5], [-0.5, 1.7]]}


def shaped(data: dict[str, Any] = DEMO, shapes: dict[str, Any] = SHAPES, **model: str) -> Design:
    data = copy.deepcopy(data) | {"model": model}
    for view in data["views"]:
        view |= shapes
    return load_design(data)


def test_weights_of_the_weighted_triangulation_are_inverse_covariances_of_its_rows():
    """sampled: rows of Eq 5 with images drawn and resected here, 20,000 times; entries of such covariances are good to
    1.5 % with an error rate of 1 in 10^3, less the second order, under 0.5 %; of all together 1.  What weights of noise
    that is alike in all directions would be is 0.07 off."""
    rng, n = np.random.default_rng(5903), 20_000
    document = document_of(rng, STILL)
    beads = np.array([each["position_mm"] for each in document["fiducials"]["points"]])
    middle = beads.mean(axis=0)
    target = np.array(document["targets"][0]["position_mm"]) - middle
    inverses = []
    for view in document["views"]:
        camera = np.array(view["projection"])
        camera[:, 3] += camera[:, :3] @ middle
        exact = np.column_stack([np.vstack([beads - middle, target]), np.ones(len(beads) + 1)]) @ camera.T
        exact = exact[:, :2] / exact[:, 2:]
        noise = [
            0.2 * rng.multivariate_normal(np.zeros(2), SHAPES[name], (n, k))
            for name, k in (("fiducial_noise_shape", 10), ("target_noise_shape", 1))
        ]
        rows, size = rows_of(beads - middle, exact[:-1] + noise[0], exact[-1] + noise[1][:, 0])
        inverses.append(np.linalg.inv(np.cov((rows @ np.append(target / size, 1)).T)))
    wanted = np.array(inverses) / np.linalg.norm(inverses)
    systems = [compile_design(shaped(document, each, triangulation="weighted")) for each in (SHAPES, {})]
    at_rest, alike = (weights_at_rest(each, each.targets[0]) for each in systems)
    np.testing.assert_allclose(at_rest / np.linalg.norm(at_rest), wanted, rtol=0.02, atol=0.01)
    assert np.abs(alike / np.linalg.norm(alike) - wanted).max() > 0.05


def test_the_weighted_triangulation_knows_the_noise_in_the_simulation_as_in_first_order():
    """sampled: standard deviations of 50,000 trials of both are alike to 4.5 standard errors, 1 in 10^5 each."""
    design = shaped(triangulation="weighted")
    told = np.sqrt(np.diag(score(design).targets[0].covariance_mm2))
    simulated = np.array(verify(design, trials=50_000, seed=4).targets[0].std_mm)
    assert np.abs(simulated / told - 1).max() <= 4.5 / np.sqrt(2 * 50_000) + 0.003


@pytest.mark.parametrize("estimator", ["dlt", "reprojection", "pose", "pose_with_prior"])
def test_what_is_alike_in_all_directions_changes_no_digit(estimator):
    alike = {name: [[1.0, 0.0], [0.0, 1.0]] for name in SHAPES}
    data = copy.deepcopy(DEMO)
    for view in data["views"]:
        view["intrinsics_prior"] = {"focal_rel_sd": 0.01, "principal_point_px_sd": 5.0}
    for form in ("normalised", "weighted"):
        plain, same = (shaped(data, shapes, estimator=estimator, triangulation=form) for shapes in ({}, alike))
        assert score(plain).targets == score(same).targets
        assert verify(plain, trials=2000).targets == verify(same, trials=2000).targets


def alone() -> dict[str, Any]:
    """The demo with image noise alone."""
    beside = ("interfaces", "execution", "optimise")
    data = {name: copy.deepcopy(each) for name, each in DEMO.items() if name not in beside}
    data["fiducials"].pop("manufacturing", None)
    return data


def test_noise_along_the_line_through_both_sources_costs_no_depth_to_be_known():
    """closed_form: noise of targets along v of both views, which is z in con, moves the target along z only."""
    data = alone()
    data["targets"] = [{"name": "t", "position_mm": [0, 0, 0]}]
    for view in data["views"]:
        view |= {"fiducial_noise_px": 0.0, "target_noise_px": 0.5, "target_noise_shape": [[0, 0], [0, 2]]}
    std = np.sqrt(np.diag(score(load_design(data)).targets[0].covariance_mm2))
    per_px = 0.194 * 700 / 1020
    np.testing.assert_allclose(std, [0, 0, 0.5 * np.sqrt(2) * per_px / np.sqrt(2)], atol=1e-5)


def test_tables_and_derivatives_follow():
    """independent: single scores, differences of scores."""
    design = shaped(triangulation="weighted")
    table = score_batch(design, {"views.*.fiducial_noise_px": [0.1, 0.7]})
    for noise, row in zip((0.1, 0.7), table.columns["p95_mm:tip"], strict=True):
        one = score(design.with_value("views.*.fiducial_noise_px", noise), losses=False)
        assert row == pytest.approx(one.targets[0].p95_mm, rel=1e-9)
    function = DesignFunction(shaped(), ["fiducials.points.F6.position_mm.2", "views.AP.fiducial_noise_px"])
    _, gradient = function.p95_gradient(function.present)
    for k, step in enumerate((0.2, 3e-3)):
        assert gradient[k] == pytest.approx(difference_by(function, k, step), rel=1e-6, abs=2e-8 / step)


def test_a_slip_is_noticed_by_residuals_in_units_of_their_noise():
    """independent: Baarda's information by a singular value decomposition; gains of a view by px are those of noise
    that is alike in all directions, as DLT weighs by none."""
    data = alone()
    plain, other = load_design(data), shaped(data)
    system = compile_design(plain)
    view, beads = system.views[1], system.fiducials_mm
    homogeneous = np.column_stack([beads, np.ones(len(beads))])

    seen, slopes = homogeneous @ view.projection.T, np.zeros((len(beads), 2, 12))
    for c in range(2):  # of the image by the entries of the projection
        slopes[:, c, 4 * c : 4 * c + 4] = homogeneous / seen[:, 2:]
        slopes[:, c, 8:] = -homogeneous * (seen[:, c] / seen[:, 2] ** 2)[:, None]
    precision = np.kron(np.eye(len(beads)), np.linalg.inv(np.array(SHAPES["fiducial_noise_shape"]) * 0.3**2))
    root = np.linalg.cholesky(precision)
    explained = np.linalg.svd(root.T @ slopes.reshape(-1, 12) / np.linalg.norm(slopes, axis=(0, 1)))[0][:, :11]
    block = (precision - root @ explained @ explained.T @ root.T)[6:8, 6:8]
    limit = chi2.isf(0.001, 2)
    noticed = brentq(lambda size: ncx2.sf(limit, 2, size) - 0.8, 1.0, 100.0)
    model = linearise(system, system.targets[0])
    (gain,) = [each.gain("tcp")[:, 6:8] for each in model.blocks if each.contributor == "fiducial_noise:LAT"]
    effect = np.sqrt(noticed * np.linalg.eigvalsh(gain @ np.linalg.inv(block) @ gain.T)[-1])
    found = score(other, reliability=True).reliability
    (slip,) = [each for each in found if (each.view, each.fiducial) == ("LAT", "F4")]
    assert slip.slip_px == pytest.approx(np.sqrt(noticed / np.linalg.eigvalsh(block)[0]), rel=1e-6)
    assert slip.effect_mm == pytest.approx(effect, rel=1e-6)


def test_the_covariance_of_eq_16_is_that_of_isotropic_noise():
    """closed_form: manufacturing errors are no image noise, and DLT weighs by none."""
    systems = [compile_design(shaped(DEMO, shapes)) for shapes in ({}, SHAPES)]
    plain, other = (linearise(each, each.targets[0]).manufacturing_block_diagonal for each in systems)
    np.testing.assert_allclose(other, plain, rtol=1e-12, atol=1e-18)


@pytest.mark.parametrize(("shape", "code", "word"), read_cases("design", "noise_shapes"))
def test_what_is_no_shape_of_noise_is_refused(shape, code, word):
    data = copy.deepcopy(DEMO)
    data["views"][0]["fiducial_noise_shape"] = shape
    problem = problems_of(load_design, data)[0]
    assert problem.pointer.startswith("/views/0/fiducial_noise_shape")
    assert problem.code == code
    assert word in f"{problem.detail} | {problem.hint}"
