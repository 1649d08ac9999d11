"""Measures of fewer than three components: their laws in a plane and on a line, against closed forms and the chain."""

from __future__ import annotations

from dataclasses import replace
from math import inf, pi, sqrt
from typing import Any

import numpy as np
import pytest
from scipy import integrate, stats
from scipy.optimize import brentq
from scipy.special import erf

from laws import linear_law
from plain_data import DEMO, problems_of
from tailstack import load_design, score, score_batch, verify
from tailstack.design import Design, compile_design
from tailstack.errors import DesignError, OutOfRangeError
from tailstack.losses import search_losses
from tailstack.measures import MEASURE
from tailstack.optimisation import optimise
from tailstack.optimisation.program import build_program
from tailstack.optimisation.task import read_task
from tailstack.optimisation.terms import terms_of
from tailstack.propagation.linear import linearise
from tailstack.system import System
from tailstack.tail.bounds import bounds
from tailstack.tail.declared import LawReading, LinearLaw, column_gradient, law_gradient, law_quantile
from tailstack.tail.gaussian import norm_quantile

TURN = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]


def gaussian(mean: Any, stds: Any, turn: Any) -> LinearLaw:
    return linear_law(turn @ np.array(mean), turn @ np.diag(np.square(stds)) @ turn.T)


def folded(r: float, m: float, s: float) -> float:
    """P(|m + s z| <= r)"""
    return 0.5 * float(erf((r - m) / (s * sqrt(2))) + erf((r + m) / (s * sqrt(2))))


def hoyt(r: float, s: float, t: float) -> float:
    """P(|e| <= r) of N(0, diag(s^2, t^2)), by one integral over the angle."""

    def beyond(a: float) -> float:
        q = (np.cos(a) / s) ** 2 + (np.sin(a) / t) ** 2
        return float(np.exp(-0.5 * r * r * q) / (q * s * t))

    return 1 - integrate.quad(beyond, 0, pi, epsabs=1e-13, epsrel=1e-13)[0] / pi


LAWS = {
    "a line": ((0.4, 0, 0), (0.3, 0, 0), lambda r: folded(r, 0.4, 0.3)),
    "a line through 0": ((0, 0, 0), (0.3, 0, 0), lambda r: folded(r, 0, 0.3)),
    "Rice": ((0.3, -0.4, 0), (0.25, 0.25, 0), lambda r: stats.rice.cdf(r, 0.5 / 0.25, scale=0.25)),
    "Hoyt": ((0, 0, 0), (0.5, 0.1, 0), lambda r: hoyt(r, 0.5, 0.1)),
}


@pytest.mark.parametrize("turn", [np.eye(3), TURN], ids=["straight", "turned"])
@pytest.mark.parametrize("name", LAWS)
def test_a_gaussian_law_in_a_plane_or_on_a_line_has_its_closed_form(name: str, turn: Any) -> None:
    """independent: erf, Rice and Hoyt; mean and mean of the worst 5 % by quadrature of what they leave beyond."""
    mean, stds, cdf = LAWS[name]
    law = gaussian(mean, stds, turn)
    for p in (0.5, 0.95, 0.999):
        r = law_quantile(law, p).quantile_mm
        assert r == pytest.approx(brentq(lambda r, p=p: cdf(r) - p, 0, 5, xtol=1e-13), rel=1e-9)
    found = LawReading(law, 0.95, 0.7)
    r = found.quantile.quantile_mm

    def beyond(start: float) -> float:
        return float(integrate.quad(lambda x: 1 - cdf(x), start, 6, epsabs=1e-12, limit=200)[0])

    assert found.mean_norm_mm == pytest.approx(beyond(0), rel=1e-9)
    assert found.cvar_mm == pytest.approx(r + beyond(r) / 0.05, rel=1e-8)
    assert found.exceedance == pytest.approx(1 - cdf(0.7), rel=1e-8)
    several = bounds(0.95, law.mean, law.covariance)
    assert several.gaussian == pytest.approx(r, rel=1e-9)
    assert several.gaussian < several.unimodal < several.moments


def test_bounds_on_a_line_are_those_of_chebyshev_and_gauss() -> None:
    law = gaussian((0, 0, 0), (0.3, 0, 0), TURN)
    found = bounds(0.95, law.mean, law.covariance)
    assert found.moments == pytest.approx(0.3 / sqrt(0.05), rel=1e-9)
    assert found.unimodal == pytest.approx(0.3 * sqrt(4 / 9 / 0.05), rel=1e-9)


def test_two_uniform_sources_across_one_another_fill_a_rectangle() -> None:
    """Closed form: the share of a rectangle that a disc covers."""
    half = np.array([0.5, 0.3])
    law = linear_law(np.zeros(3), np.zeros((3, 3)), TURN[:, :2] * half)
    r = law_quantile(law, 0.9).quantile_mm
    covered = integrate.quad(lambda x: min(half[1], sqrt(r * r - x * x)), 0, min(r, half[0]))[0] / half.prod()
    assert covered == pytest.approx(0.9, abs=2e-4)  # sampled: a law without noise has no lattice


@pytest.mark.parametrize("beyond", [0.0, 0.3])
@pytest.mark.parametrize("dimension", [1, 2])
def test_derivatives_in_a_plane_or_on_a_line_are_those_of_differences(dimension: int, beyond: float) -> None:
    """independent: differences of exact quantiles in the plane; out of it, that no turn changes a length.  beyond: how
    far off it the mean is."""
    rng = np.random.default_rng(dimension)
    plane, step = TURN[:, :dimension], 1e-4
    factor = 0.3 * plane @ rng.normal(size=(dimension, dimension))
    mean = 0.5 * plane @ rng.normal(size=dimension) + beyond * TURN[:, 2]
    law = linear_law(mean, factor @ factor.T, 0.4 * plane @ rng.normal(size=(dimension, 4)), [0, 1, 0, 1])
    total = law_quantile(law, 0.95)
    gradient, by_column = law_gradient(law, total), column_gradient(law, total)

    def slope(mean: Any = 0, covariance: Any = 0, columns: Any = 0) -> float:
        more, less = (
            law_quantile(
                LinearLaw(law.mean + s * mean, law.covariance + s * covariance, law.columns + s * columns, law.kinds),
                0.95,
            ).quantile_mm
            for s in (step, -step)
        )
        return (more - less) / (2 * step)

    assert gradient.by_mean == pytest.approx([slope(mean=unit) for unit in np.eye(3)], abs=2e-6)
    inside = plane @ rng.normal(size=(dimension, dimension))
    inside = 0.1 * inside @ inside.T
    assert (gradient.by_covariance * inside).sum() == pytest.approx(slope(covariance=inside), abs=2e-6)
    for j in range(4):
        change = np.outer(plane @ rng.normal(size=dimension), np.arange(4) == j)
        assert (by_column * change).sum() == pytest.approx(slope(columns=change), abs=2e-6)
    turn = np.cross(np.eye(3), rng.normal(size=3))  # which changes no length
    turned = gradient.by_mean @ turn @ law.mean + 2 * (gradient.by_covariance * (turn @ law.covariance)).sum()
    assert turned + (by_column * (turn @ law.columns)).sum() == pytest.approx(0, abs=1e-7)
    assert gradient.by_log_column == pytest.approx((by_column * law.columns).sum(axis=0), abs=1e-8)


def directed(direction: Any = (1.0, 2.0, -2.0), **requirement: Any) -> dict[str, Any]:
    data = {name: value for name, value in DEMO.items() if name != "optimise"}
    data["targets"] = [dict(data["targets"][0], direction=list(direction))]
    entry = {"name": "side", "error": "lateral", "limit_mm": 1.0, **requirement}
    data["requirements"] = [*data["requirements"], entry]
    return data


def test_a_requirement_without_a_direction_says_what_to_declare() -> None:
    data = directed()
    del data["targets"][0]["direction"]
    (problem,) = problems_of(lambda: compile_design(load_design(data)), error=DesignError)
    assert (problem.pointer, problem.code) == ("/requirements/1/targets", "no-site")
    assert problem.hint == "it takes a target with direction: [x, y, z] in con, or entry: NAME of another"
    with pytest.raises(DesignError, match="direction has a length"):
        load_design(directed(direction=(0.0, 0.0, 0.0)))


def entered(length_mm: float = 30.0, **requirement: Any) -> dict[str, Any]:
    """The demo with a second target above the tip, through which the drill comes."""
    data = {name: value for name, value in DEMO.items() if name != "optimise"}
    tip = data["targets"][0]
    x, y, z = tip["position_mm"]
    entry = {"name": "entry", "position_mm": [x, y, z - length_mm]}
    data["targets"] = [dict(tip, entry="entry"), entry]
    limit = {"name": "straight", "error": "angle", "limit_deg": 0.6, **requirement}
    data["requirements"] = [*data["requirements"], limit]
    return data


def test_an_angle_where_fiducials_are_missed_is_that_of_all_shots() -> None:
    """The full chain, its interval of 95 % widened to 99.9 %, and by 3 % for what first order leaves out."""
    data = entered()
    whole = score(load_design(data), losses=False).measures[-1].p95
    often = load_design(data | {"fiducials": {**data["fiducials"], "loss_probability": 0.05}})
    bound, drawn = score(often, losses=False).measures[-1].p95, verify(often, trials=20_000, seed=2)
    alike = search_losses(compile_design(often)).law_of_simulation("entry to tip", "angle", 0.95).quantile(0.95)
    low, high = drawn.measures[-1].p95_interval or (0.0, inf)
    spread = (high - low) * (3.29 / 1.96 - 1) / 2 + 0.03 * alike
    assert low - spread < alike < high + spread
    assert bound > alike > whole  # more than two missed count as beyond the bound
    expected = "pass" if high <= 0.6 else "fail" if low > 0.6 else "inconclusive"
    assert drawn.verdict.checks[-1].status == expected


def to_optimise() -> Design:
    """Nothing but the angle is limited, images of the target are sharp, and one half-width is to be optimised."""
    data = entered()
    free = {"interface": "structure_connector", "component": "rx", "min_deg": 0.001, "max_deg": 3.0}
    data["optimise"] = {"requirement": "straight", "tolerances": [free]}
    data["fiducials"] = {name: each for name, each in data["fiducials"].items() if name != "diameter_mm"}
    data["views"] = [dict(view, target_noise_px=0.05) for view in data["views"]]
    return load_design(data)


def angle(system: System) -> float:
    return score(system, losses=False).measures[-1].p95


@pytest.mark.long
def test_a_budget_keeps_an_angle() -> None:
    """brute force: the largest half-width at which the score has the angle within its limit."""
    found, words = optimise(to_optimise(), starts=3), MEASURE["angle"].words
    check = found.certificate.verification.verdict.checks[-1]
    assert (check.requirement, check.status, check.unit) == ("straight", "pass", "deg")
    assert check.upper <= 0.6
    assert f"P95 of {words} within 0.6 deg" in found.objective
    assert f"P95 of {words} at target 'entry to tip', limit 0.6 deg (straight)" in found.binding
    new = compile_design(load_design(found.design))
    seat = new.structure_connector

    def excess(width: float) -> float:
        sources = replace(seat.sources, half_width=np.array([width, *seat.sources.half_width[1:]]))
        return angle(replace(new, structure_connector=replace(seat, sources=sources))) - 0.6

    assert found.cost_exact_law == pytest.approx(1 / brentq(excess, 1e-4, 0.1, xtol=1e-14), rel=1e-5)


def two_shots(length_mm: float = 30.0, **requirement: Any) -> dict[str, Any]:
    data = entered(length_mm, **requirement)
    data["targets"][0] |= {"ends": "two_shots", "corridor_mm": 1.5}
    return data


def test_what_is_drawn_anew_at_each_end_decides_an_angle() -> None:
    """independent: sums over the gains at both ends.  Ends drawn apart would have seven times the angle; of a short
    axis only the noise of the two images is left, unless each end has a shot of its own; results say which."""

    def p95(length_mm: float, *apart: str) -> float:
        system = compile_design(load_design(entered(length_mm)))
        along = system.T_tcp_con[:3, :3] @ [0.0, 0.0, 1.0]
        across, total = np.eye(3) - np.outer(along, along), np.zeros((3, 3))
        for blocks in zip(*(linearise(system, target).blocks for target in system.targets), strict=True):
            tip, entry = (across @ block.gain("tcp") * block.spread for block in blocks)
            own = blocks[0].effect.drawn in apart or blocks[0].contributor.startswith("target_noise")
            total += tip @ tip.T + entry @ entry.T if own else (tip - entry) @ (tip - entry).T
        return float(np.rad2deg(norm_quantile(0.95, np.zeros(3), total))) / length_mm

    words = "both ends share all that is drawn", "each end has images and a pose of its own"
    for length_mm in (30.0, 1e-3):
        for stated, said, apart in ((entered, words[0], ()), (two_shots, words[1], ("shot",))):
            estimate = score(load_design(stated(length_mm)), losses=False)
            angle = next(each.p95 for each in estimate.measures if each.measure == "angle")
            assert angle == pytest.approx(p95(length_mm, *apart), rel=5e-3)  # uniform sources are taken for normal here
            assert f"trajectory entry to tip: {said}" in " ".join(estimate.provenance.notes)
    assert p95(30.0, "shot") > 1.4 * p95(30.0)
    assert p95(30.0, "unit", "shot") > 6 * p95(30.0)


@pytest.mark.long
def test_trials_of_two_shots_are_what_first_order_says() -> None:
    """sampled: 100,000 trials, whose interval of 95 % is widened by the 1 % that first order may leave out, pooled and
    of each unit."""
    corridor = two_shots(error="corridor", limit_deg=None, limit_mm=2.0)
    for data in (two_shots(), two_shots(risk="per_unit", min_yield=0.9), corridor):
        found, check = (f(load_design(data)).verdict.checks[-1] for f in (score, lambda d: verify(d, trials=100_000)))
        low, high = check.interval
        assert 0.99 * low < found.value < 1.01 * (high or 0.0)


def test_what_is_not_known_of_two_shots_is_refused_or_left_out() -> None:
    assert [line.requirement for line in score(load_design(two_shots())).losses] == ["tip-accuracy"]
    data = two_shots()
    batch = score_batch(load_design(data), {"views.*.target_noise_px": [0.2, 0.3]}, columns=("value",))
    assert batch.ways["in full"] == 2
    with pytest.raises(OutOfRangeError, match="the angle of the executed axis is of two shots, and rays are of one"):
        verify(load_design(data), method="radial")
    with pytest.raises(DesignError, match="limits the angle of the executed axis of two shots, which no search knows"):
        optimise(load_design(data | {"optimise": DEMO["optimise"] | {"requirement": "straight"}}))
    with pytest.raises(DesignError, match="which fiducials a shot misses: not known of two shots"):
        compile_design(load_design(data | {"fiducials": DEMO["fiducials"] | {"loss_probability": 0.01}}))
    with pytest.raises(DesignError, match="ends is read only beside entry"):
        load_design(directed() | {"targets": [DEMO["targets"][0] | {"ends": "two_shots"}]})


def test_a_limit_is_in_the_unit_of_its_measure() -> None:
    with pytest.raises(DesignError, match="angle is limited by limit_deg"):
        load_design(entered(limit_mm=1.0))
    with pytest.raises(DesignError, match="a requirement on tcp needs limit_mm"):
        load_design(entered(error="tcp", limit_deg=None))
    data = entered()
    data["targets"][0]["entry"] = "enty"
    with pytest.raises(DesignError, match="no target elsewhere is called 'enty'"):
        load_design(data)


def test_the_programme_of_an_angle_serves_another_limit() -> None:
    """What trials have whole, a function of the measure, is no part of it."""
    (problem,) = read_task(to_optimise()).problems
    other = replace(problem, requirements=tuple(replace(each, limit=0.7) for each in problem.requirements))
    first, again = (build_program(each, tuple(terms_of(each, d) for d in each.demands)) for each in (problem, other))
    assert again.explore[0] is first.explore[0]
