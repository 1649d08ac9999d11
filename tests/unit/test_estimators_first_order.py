"""First order of every estimator: against differences of the plain estimators, the published table, and its limits;
and what docs/estimators.md and docs/layouts.md say of it in numbers."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reference_chain import run
from scenes import (
    cube_fiducials,
    mount,
    projection_looking,
    random_rigid,
    random_system,
    read_only,
    system_of,
    target,
    with_intrinsics,
    with_noise,
    with_unseen,
)
from tailstack import load_design, score
from tailstack.errors import OutOfRangeError
from tailstack.estimation.least_squares import estimate_views
from tailstack.estimation.resection import project
from tailstack.propagation.linear import covariance, estimation_of, estimator_geometry, linearise
from tailstack.propagation.nonlinearity import least_squares_matrix_gains, matrix_gains
from tailstack.studies.estimators import study_estimators
from tailstack.system import Estimator, Reading, System, Triangulation
from tailstack.tail.gaussian import norm_quantile

ORACLE = json.loads((Path(__file__).parents[1] / "data" / "oracles" / "estimators.json").read_text())
STEPS = {"rad": 1e-3, "mm": 3e-2, "px": 3e-2, "N": 1.0, "1": 1e-4}


def knowing(system: System, focal: float, centre_px: float, bias=(0.0, 0.0, 0.0)) -> System:
    """The system whose views know their intrinsics so well, and err by as much."""
    wide = [focal, centre_px, centre_px] if focal else (0.0, 0.0, 0.0)
    return with_intrinsics(system, wide, bias, prior=(focal, centre_px) if focal else None)


def p95_mm(system: System) -> float:
    model = linearise(system, system.targets[0])
    return norm_quantile(0.95, model.bias_mm("tcp"), covariance(model, "tcp"))


@pytest.mark.parametrize("row", ORACLE["p95_mm"]["rows"], ids=lambda row: f"{row[0]} mm")
def test_the_published_table_to_its_printed_digits(row):
    """oracle: finite differences of the images and Gauss-Markov, by another program."""
    half, dlt, eleven, rough, good, pose = row
    cube = system_of(cube_fiducials(half), views=with_noise(0.5))
    found = [
        p95_mm(cube),
        p95_mm(replace(cube, estimator=Estimator.REPROJECTION)),
        p95_mm(knowing(replace(cube, estimator=Estimator.POSE_WITH_PRIOR), 0.01, 10.0)),
        p95_mm(knowing(replace(cube, estimator=Estimator.POSE_WITH_PRIOR), 0.002, 2.0)),
        p95_mm(replace(cube, estimator=Estimator.POSE)),
    ]
    assert np.round(found, 4).tolist() == [dlt, eleven, rough, good, pose]
    wrong = knowing(replace(cube, estimator=Estimator.POSE), 0.0, 0.0, bias=(0.01, 0.0, 0.0))
    bias = float(np.linalg.norm(linearise(wrong, wrong.targets[0]).bias_mm("tcp")))
    assert round(bias, 3) == ORACLE["bias_if_focal_length_assumed_1pct_long_mm"][str(half)]
    assert f"| {half} |{''.join(f' {value:.4f} |' for value in found)} {bias:.3f} |" in PAGE
    if half == 50:
        estimated = float(np.linalg.norm(run(wrong, wrong.targets[0], {})["tcp"]))
        assert f"is {bias:.4f} mm off by this, and {estimated:.4f} mm by estimating" in PAGE
        perfect = system_of(cube_fiducials(half), views=with_noise(1e-6, 0.5), estimator=Estimator.POSE)
        assert f"Target pixels alone make {p95_mm(perfect):.3f}." in PAGE


@pytest.mark.long(but=("dlt-normalised", "dlt-weighted", "dlt-reprojection", "reprojection-weighted"))
@pytest.mark.parametrize("form", [Triangulation.NORMALISED, Triangulation.WEIGHTED, Triangulation.REPROJECTION])
@pytest.mark.parametrize("estimator", list(Estimator))
def test_every_gain_equals_the_finite_difference_of_the_plain_estimator(estimator, form):
    """independent: central differences of Gauss-Newton by QR in another parametrisation, Richardson's step pair."""
    reading = Reading.EQ18 if estimator is Estimator.POSE else Reading.PHYSICAL
    system = random_system(np.random.default_rng(7), fiducials=9, views=3, reading=reading)
    loud = replace(system.views[2], fiducial_noise_px=1.1, target_noise_px=0.2)
    system = with_unseen(replace(system, views=(*system.views[:2], loud)), 1, system.fiducial_labels[:1])
    system = knowing(replace(system, estimator=estimator, triangulation=form), 0.01, 5.0)
    aim = system.targets[0]
    model = linearise(system, aim)
    assert ("assumed_intrinsics:view0" in {b.contributor for b in model.blocks}) == estimator.believes_intrinsics
    unperturbed = run(system, aim, {})
    assert np.allclose(unperturbed["tcp"], model.bias_mm("tcp"), rtol=0, atol=1e-7)
    for block in model.blocks:
        for j, unit in enumerate(block.units):
            kick = np.eye(len(block.units))[j]

            def slope(h, kick=kick, name=block.contributor):
                ahead, behind = (run(system, aim, {name: s * h * kick})["tcp"] for s in (1, -1))
                return (ahead - behind) / (2 * h)

            numeric = (4 * slope(STEPS[unit]) - slope(2 * STEPS[unit])) / 3
            scale = 1 + np.abs(block.gain("tcp")).max()
            assert np.allclose(numeric, block.gain("tcp")[:, j], rtol=0, atol=1e-6 * scale), (block.contributor, j)


def test_a_known_error_of_intrinsics_moves_the_target_as_the_estimator_does_to_first_order():
    """independent: the plain estimators told wrong intrinsics; what is left goes with the square of the error."""
    for estimator in (Estimator.POSE, Estimator.POSE_WITH_PRIOR):
        base = knowing(random_system(np.random.default_rng(4), fiducials=8, estimator=estimator), 0.02, 5.0)
        still = run(base, base.targets[0], {})["tcp"]
        left = []
        for size in (0.5, 1.0):
            bias = read_only(size * np.array([0.004, 3.0, -2.0]))
            system = with_intrinsics(base, bias=bias)
            moved = run(system, system.targets[0], {})["tcp"]
            first_order = linearise(system, system.targets[0]).bias_mm("tcp")
            assert np.linalg.norm(moved - still) > 20 * np.linalg.norm(moved - first_order)
            left.append(np.linalg.norm(moved - first_order))
        assert left[1] / left[0] == pytest.approx(4.0, rel=0.1)


def test_limits_of_the_prior_and_of_free_unknowns():
    """closed form: nothing known is nine unknowns by least squares, between DLT's and the pose; all known, the pose."""
    cube = system_of(cube_fiducials(30), views=with_noise(0.5))
    pose = p95_mm(replace(cube, estimator=Estimator.POSE))
    prior = replace(cube, estimator=Estimator.POSE_WITH_PRIOR)
    by_prior = [p95_mm(knowing(prior, size, 1000 * size)) for size in (1e-6, 1e-3, 1e-2, 1e-1, 1.0, 1e3)]
    assert by_prior[0] == pytest.approx(pose, rel=1e-7)
    assert (np.diff(by_prior) > 0).all()
    nine = p95_mm(prior)  # no view says what it knows
    assert by_prior[-1] == pytest.approx(nine, rel=1e-3)
    eleven = p95_mm(replace(cube, estimator=Estimator.REPROJECTION))
    assert pose < nine < eleven < p95_mm(cube)
    # and a pose that ignores a prior's doubt is worse than one that weighs it
    rough = knowing(prior, 0.05, 50.0)
    assert p95_mm(replace(rough, estimator=Estimator.POSE)) > p95_mm(rough)


@pytest.mark.parametrize("estimator", [Estimator.POSE, Estimator.POSE_WITH_PRIOR, Estimator.REPROJECTION])
def test_first_order_turns_with_the_structure_follows_units_and_does_not_feel_a_rigid_bias(estimator):
    """closed form: in another frame the covariance turns; a known installation error moves the structure and the
    coordinates together."""
    system = knowing(system_of(cube_fiducials(30), views=with_noise(0.5), estimator=estimator), 0.01, 5.0)
    here = covariance(linearise(system, system.targets[0]), "localisation")
    motion = random_rigid(np.random.default_rng(3))
    into, turn = np.linalg.inv(motion), motion[:3, :3]
    aim = (motion @ [*system.targets[0].position_mm, 1.0])[:3]
    there = replace(
        system,
        views=tuple(replace(v, projection=read_only(v.projection @ into)) for v in system.views),
        fiducials_mm=read_only(system.fiducials_mm @ turn.T + motion[:3, 3]),
        targets=(target(aim),),
    )
    turned = covariance(linearise(there, there.targets[0]), "localisation")
    np.testing.assert_allclose(turned, turn @ here @ turn.T, rtol=0, atol=1e-8 * np.abs(here).max())
    bias = mount("structure_connector", (0, 0, -95), bias=[*np.deg2rad([1, -0.5, 2]), 2, -1, 3])
    eq18 = replace(system, structure_connector=bias, reading=Reading.EQ18)
    model = linearise(eq18, eq18.targets[0])
    moved = run(replace(eq18, reading=Reading.EQ18), eq18.targets[0], {})["localisation"]
    np.testing.assert_allclose(model.bias_mm("localisation"), moved, rtol=0, atol=1e-8)
    assert np.trace(covariance(model, "localisation")) == pytest.approx(np.trace(here), rel=1e-6)


def test_weights_at_unequal_depth():
    """published: source distances of 500 and 800 mm give P95 0.2448 mm with rows weighted by depth; least squares of
    images differ by some per cent, and weighing each view by what is known of it is best of all."""
    views = tuple(
        replace(view, projection=projection_looking(angle, depth))
        for view, angle, depth in zip(with_noise(0.5), (0.0, np.pi / 2), (500.0, 800.0), strict=True)
    )
    system = system_of(cube_fiducials(50), views=views)
    found = {form: p95_mm(replace(system, triangulation=form)) for form in Triangulation}
    assert round(found[Triangulation.NORMALISED], 4) == 0.2448
    assert found[Triangulation.PUBLISHED] == pytest.approx(found[Triangulation.NORMALISED], rel=1e-12)
    assert found[Triangulation.WEIGHTED] < min(found[Triangulation.REPROJECTION], found[Triangulation.NORMALISED])


@pytest.mark.parametrize("estimator", [Estimator.POSE, Estimator.POSE_WITH_PRIOR, Estimator.REPROJECTION])
def test_every_gain_of_a_matrix_equals_the_difference_of_two_estimates(estimator):
    """independent: plain estimates of kicked images and of wrong intrinsics, P over the depth of the centroid."""
    system = knowing(random_system(np.random.default_rng(11), fiducials=8, estimator=estimator), 0.01, 5.0)
    projections, points, _ = estimator_geometry(system)
    system = replace(
        system, views=tuple(replace(v, projection=p) for v, p in zip(system.views, projections, strict=True))
    )
    centre = points.mean(axis=0)
    about = projections[0] @ np.block([[np.eye(3), centre[:, None]], [np.zeros((1, 3)), 1.0]])
    images = np.array([project(p, points) for p in projections])

    def centred(kick, wrong):
        p = estimate_views(system, points, images + kick, np.array([wrong, wrong]))[0]
        p = p @ np.block([[np.eye(3), centre[:, None]], [np.zeros((1, 3)), 1.0]])
        p[:2] -= (about[:2, 3] / about[2, 3])[:, None] * p[2]
        return (p / p[2, 3]).ravel() * about[2, 3]

    estimation = estimation_of(system)
    found = least_squares_matrix_gains(projections[0], points, np.ones(8), estimation.unknowns, estimation.precision[0])
    nothing = np.zeros(3)
    for i, c in ((0, 0), (3, 1), (7, 0)):
        kick = np.zeros(images.shape)
        kick[0, i, c] = 0.02
        numeric = (centred(kick, nothing) - centred(-kick, nothing)) / 0.04
        np.testing.assert_allclose(numeric, found.by_noise[:, i, c], rtol=0, atol=1e-5 * np.abs(numeric).max())
    for k, step in enumerate((1e-4, 0.02, 0.02)):
        wrong = step * np.eye(3)[k]
        numeric = (centred(0.0, wrong) - centred(0.0, -wrong)) / (2 * step)
        rounding = 1e-15 * np.abs(about).max() / step  # all there is where it is an unknown of the estimator itself
        left = 1e-4 * np.abs(numeric).max() + rounding
        np.testing.assert_allclose(numeric, found.by_intrinsics[:, k], rtol=0, atol=left)
    if estimator is Estimator.REPROJECTION:  # among its weights are those of DLT where all depths are alike
        assert found.by_noise.shape == matrix_gains(projections[0], points, np.ones(8)).shape


def test_the_budget_has_a_line_for_each_assumed_intrinsic_in_its_unit():
    cube = system_of(cube_fiducials(30), views=with_noise(0.5), estimator=Estimator.POSE)
    lines = {(c.name, c.component): c for c in score(knowing(cube, 0.01, 10.0)).targets[0].contributors}
    focal, centre = (lines["assumed_intrinsics:view0", name] for name in ("focal", "principal_point_u"))
    assert (focal.half_width, focal.unit, centre.half_width, centre.unit) == (pytest.approx(1.0), "%", 10.0, "px")
    assert focal.label == "assumed intrinsics, view0"
    assert focal.variance_share > 0


ROOT = Path(__file__).resolve().parents[2]
PAGE = " ".join((ROOT / "docs" / "estimators.md").read_text(encoding="utf-8").split())


def test_what_knowing_is_worth_to_the_drill_guide_is_what_the_study_says() -> None:
    study = study_estimators(load_design(ROOT / "examples" / "demo.yaml"))
    dlt, prior = (next(case for case in study.cases if case.estimator == name) for name in ("dlt", "pose_with_prior"))
    assert f"The drill guide goes from {dlt.p95_mm:.3f} to {prior.p95_mm:.3f} mm" in PAGE
    assert f"Its structure of {study.extent_mm:.0f} mm could shrink to {prior.same_size_mm:.0f} mm" in PAGE


def test_the_published_figures_stand_side_by_side():
    """published: P95 of the cube of eight at 20 mm under DLT, least squares, prior of 1 % and 10 px, and the pose."""
    study = study_estimators(system_of(cube_fiducials(20), views=with_noise(0.5)), trials=8192)
    found = {case.estimator: case for case in study.cases}
    assert [round(found[name].p95_mm or 0, 4) for name in ("dlt", "reprojection", "pose_with_prior")] == [
        1.0, 0.9984, 0.3003,
    ]  # fmt: skip
    assert round(found["pose"].p95_exact_mm or 0, 4) == 0.2985
    for case in study.cases:
        low, high = case.simulated_interval_mm
        assert low * 0.99 < (case.p95_mm or 0) < high * 1.03
    assert "from 1.000 to 0.300 mm (-70 %)" in study.conclusions[0]


def test_a_structure_of_the_size_it_names_does_as_well():
    """independent: the score of the shrunk structure under the prior, against DLT's of the whole one."""
    system = system_of(cube_fiducials(20), views=with_noise(0.5))
    study = study_estimators(system)
    case = next(case for case in study.cases if case.estimator == "pose_with_prior")
    assert study.extent_mm == pytest.approx(40 * np.sqrt(3))
    scale = case.same_size_mm / study.extent_mm
    centre = system.fiducials_mm.mean(axis=0)
    known = study_estimators(replace(system, fiducials_mm=centre + scale * (system.fiducials_mm - centre)))
    shrunk = next(case for case in known.cases if case.estimator == "pose_with_prior")
    assert shrunk.p95_mm == pytest.approx(score(system).targets[0].p95_mm, rel=0.02)
    assert f"A structure of {case.same_size_mm:.0f} mm with known intrinsics" in study.conclusions[1]


def test_an_estimator_without_an_answer_says_why():
    four = system_of(cube_fiducials(50)[[0, 3, 5, 6]], views=with_noise(0.5))
    study = study_estimators(four)
    answered = {case.estimator: case.p95_mm is not None for case in study.cases}
    assert answered == {"dlt": False, "reprojection": False, "pose_with_prior": True, "pose": True}
    assert "4 fiducials arrived" in study.cases[0].reason
    assert study.conclusions[0].startswith("Without known intrinsics this design has no answer")
    two = system_of(cube_fiducials(50)[:2], views=with_noise(0.5), estimator=Estimator.POSE)
    with pytest.raises(OutOfRangeError, match="no estimator has an answer"):
        study_estimators(two)


def test_intrinsics_that_the_study_takes_for_wrong_are_not_listed_as_taken_for_exact():
    system = system_of(cube_fiducials(20), views=with_noise(0.5), estimator=Estimator.POSE)
    assert any("focal length" in line for line in score(system).provenance.not_included)
    assert not any("focal length and" in line for line in study_estimators(system).provenance.not_included)
