"""What counts on one side of 0 alone: laws, units, worst ends, losses, trials and optimum against closed forms."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from itertools import product
from math import sqrt
from typing import Any

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import brentq

from optimise_documents import document
from plain_data import DEMO
from tailstack import load_design, score, verify
from tailstack.design import compile_design, design_to_data
from tailstack.errors import DesignError
from tailstack.laws import SUMS
from tailstack.montecarlo.chain import run_indices
from tailstack.montecarlo.plan import compile_plan
from tailstack.optimisation import optimise
from tailstack.system import Law
from tailstack.tail.bounded import worst_case
from tailstack.tail.declared import (
    LawReading,
    LinearLaw,
    column_gradient,
    law_exceedance,
    law_gradient,
    law_quantile,
)
from tailstack.tail.per_unit import unit_risk

HALF = np.full(1, np.inf)


def on_a_line(mean: float, std: float, widths: Any = (), kinds: Any = ()) -> LinearLaw:
    first = np.eye(3)[0]
    columns = np.outer(first, np.array(widths, dtype=float))
    return LinearLaw(mean * first, np.outer(first, first) * std**2, columns, np.array(kinds, dtype=np.int64), HALF)


@pytest.mark.parametrize("mean", [0.4, 0.0, -0.3, -2.0])
def test_a_normal_number_has_its_closed_form(mean: float) -> None:
    """closed_form: of max(x, 0), x normal; at -2 nothing up to P95 is above 0."""
    law, z = on_a_line(mean, 0.5), stats.norm.ppf(0.95)
    found = LawReading(law, 0.95, 0.6)
    p95, x = max(mean + z * 0.5, 0.0), stats.norm(mean, 0.5)

    def excess(r: float) -> float:
        return float((mean - r) * x.sf(r) + 0.25 * x.pdf(r))

    assert found.quantile.quantile_mm == pytest.approx(p95, abs=1e-9)
    assert found.exceedance == pytest.approx(x.sf(0.6), rel=1e-9)
    assert found.mean_norm_mm == pytest.approx(excess(0.0), rel=1e-8, abs=1e-12)
    assert found.cvar_mm == pytest.approx(p95 + excess(p95) / 0.05, rel=1e-8, abs=1e-12)
    slopes, above = law_gradient(law, found.quantile), float(p95 > 0)
    np.testing.assert_allclose(slopes.by_mean, [above, 0, 0], atol=1e-8)
    assert slopes.by_covariance[0, 0] == pytest.approx(above * z / (2 * 0.5), rel=1e-7)


@pytest.mark.parametrize("mean", [0.2, -0.4])
def test_a_sum_of_declared_laws_is_that_of_an_integral(mean: float) -> None:
    """independent: a convolution by quadrature; derivatives by differences of it."""
    kinds = [SUMS.index(Law.UNIFORM), SUMS.index(Law.TRIANGULAR)]

    nodes, weights = np.polynomial.legendre.leggauss(80)
    half, share = (1 + nodes) / 2, weights / 2  # of the triangle on one side

    def below(r: float, widths: Any) -> float:
        u, v = np.meshgrid(nodes, np.concatenate([half, -half]))
        weight = np.outer(np.tile(share * (1 - half), 2), weights / 2)
        return float((stats.norm.cdf((r - mean - widths[0] * u - widths[1] * v) / 0.1) * weight).sum())

    def quantile(widths: Any) -> float:
        return float(brentq(lambda r: below(r, widths) - 0.95, -2, 2, xtol=1e-12))

    law, widths = on_a_line(mean, 0.1, (0.5, 0.3), kinds), np.array([0.5, 0.3])
    found = law_quantile(law, 0.95)
    assert found.quantile_mm == pytest.approx(max(quantile(widths), 0.0), abs=1e-7)
    assert law_exceedance(law, 0.3) == pytest.approx(1 - below(0.3, widths), abs=1e-7)
    if mean > 0:
        steps = 1e-4 * np.eye(2)
        slopes = [(quantile(widths + step) - quantile(widths - step)) / 2e-4 for step in steps]
        np.testing.assert_allclose(law_gradient(law, found).by_log_column / widths, slopes, rtol=1e-5)
        by_column = column_gradient(law, found)
        np.testing.assert_allclose(by_column[0], slopes, rtol=1e-5)


def test_units_add_what_they_keep_to_the_quantile_of_their_shots() -> None:
    """closed_form: of a unit at d the quantile is d + z s."""
    held, shot = on_a_line(-0.2, 0.5), on_a_line(0.0, 0.2)
    risk, z = unit_risk(held, shot, 0.95, 0.6, 0.9), stats.norm.ppf([0.95, 0.9])
    assert risk.value_mm == pytest.approx(-0.2 + z[1] * 0.5 + z[0] * 0.2, abs=1e-9)
    assert risk.yield_fraction == pytest.approx(stats.norm.cdf((0.6 - z[0] * 0.2 + 0.2) / 0.5), abs=1e-9)
    assert unit_risk(replace(held, mean=np.array([-3.0, 0, 0])), shot, 0.95, 0.6, 0.9).value_mm == 0.0


@pytest.mark.parametrize("mean", [-1.0, 0.0, 1.0])
def test_the_worst_end_is_the_one_on_that_side(mean: float) -> None:
    """brute force: all ends; of a size the worst one changes sides with the known part, here it never does."""
    law, bounded = on_a_line(mean, 0.1, (0.05,), (0,)), np.outer(np.eye(3)[0], [0.3, -0.2])
    every = {
        ends: law_quantile(replace(law, mean=law.mean + bounded @ np.array(ends)), 0.95).quantile_mm
        for ends in product((1, -1), repeat=2)
    }
    found = worst_case(law, bounded, 0.95)
    assert found.signs == (1, -1)
    assert found.quantile.quantile_mm == pytest.approx(max(every.values()), abs=1e-9)


def one_sided(error: str = "axial", side: str = "above", **requirement: Any) -> dict[str, Any]:
    data = {name: value for name, value in DEMO.items() if name != "optimise"}
    data["targets"] = [dict(DEMO["targets"][0], direction=[1.0, 2.0, -2.0])]
    data["requirements"] = [{"name": "depth", "error": error, "side": side, "limit_mm": 0.4, **requirement}]
    return data


def test_trials_count_what_is_on_that_side() -> None:
    """independent: the vectors of 20,000 trials, by a dot product; estimates within 2 % and four standard errors."""
    errors = run_indices(compile_plan(compile_design(load_design(one_sided()))), 5, 0, 20_000).errors[0, 0]
    turn = compile_design(load_design(one_sided())).T_tcp_con[:3, :3]
    along, beyond = turn @ np.array([1.0, 2.0, -2.0]) / 3 @ errors, []
    for side, sign in (("above", 1.0), ("below", -1.0)):
        design = load_design(one_sided(side=side))
        (check,) = verify(design, trials=20_000, seed=5).verdict.checks
        own = np.sort(np.maximum(sign * along, 0.0))
        assert (check.error, check.value) == (f"axial_{side}", pytest.approx(own[19_000 - 1], rel=1e-12))
        found = next(each for each in score(design, losses=False).measures if each.measure == check.error)
        assert found.mean == pytest.approx(own.mean(), rel=0.02, abs=4 * own.std() / sqrt(20_000))
        assert found.known == pytest.approx(float(sign * along.mean()), abs=0.01)
        beyond.append(found.exceedance_probability)
    both = score(load_design({**one_sided(), "requirements": [
        {"name": "depth", "error": "axial", "limit_mm": 0.4}]}), losses=False).measures[1]  # fmt: skip
    assert sum(beyond) == pytest.approx(both.exceedance_probability, rel=1e-7)


@pytest.mark.long
def test_all_shots_count_where_fiducials_are_missed() -> None:
    """closed_form: both sides together are either way, in every pattern of missed fiducials that is looked at; the
    others, of three and more of twelve, count as beyond on each side."""

    def beyond(**requirement: Any) -> float:
        data = one_sided()
        data["fiducials"] = {**data["fiducials"], "loss_probability": 0.02}
        data["requirements"] = [{"name": "depth", "error": "axial", "limit_mm": 0.4, **requirement}]
        found = score(load_design(data), losses=False, fifty_shots=True)
        assert None not in found.fifty_shots.values[:45]
        name = "_".join(["axial", *requirement.values()])
        return next(each for each in found.measures if each.measure == name).exceedance_probability or 0.0

    twice = stats.binom.sf(2, len(DEMO["fiducials"]["points"]), 0.02)
    assert beyond(side="above") + beyond(side="below") == pytest.approx(beyond() + twice, rel=1e-6)


def test_a_side_is_of_a_number_with_a_sign() -> None:
    with pytest.raises(DesignError, match="side is read only with error: axial, x, y, z, localisation_x") as caught:
        load_design(one_sided(error="lateral"))
    assert caught.value.problems[0].pointer == "/requirements/0/side"
    kept = design_to_data(load_design(one_sided(error="x", side="below")))["requirements"][0]
    assert (kept["error"], kept["side"]) == ("x", "below")


@pytest.mark.long
@pytest.mark.parametrize("more", [{}, {"statistic": "cvar"}, {"risk": "per_unit", "min_yield": 0.9}], ids=str)
def test_an_optimum_uses_a_known_part_on_the_other_side(more: dict[str, Any]) -> None:
    """closed_form: the error along x is normal, its variance linear in the squared half-width that is free; the largest
    at which what is limited keeps its limit (of each unit, to what its search settles to).  A load that pushes to the
    other side leaves more of it."""
    close = 1e-3 if "risk" in more else 1e-5
    free = {"interface": "structure_connector", "component": "ry", "min_deg": 0.001, "max_deg": 3.0}
    costs = {}
    for force in (0.0, -30.0):
        data = document(tolerances=[free], limit_mm=1.0)
        data["execution"] = {"compliance": {"matrix_mm_per_n": (0.01 * np.eye(3)).tolist(), "load_n": [force, 0, 0]}}
        data["requirements"] = [{"name": "right", "error": "x", "side": "above", "limit_mm": 0.5, **more}]
        found = optimise(load_design(data), starts=2)
        costs[force] = found.cost_exact_law
        (check,) = found.certificate.verification.verdict.checks
        assert (check.error, check.status) == ("x_above", "pass")
        new = compile_design(load_design(found.design))

        def excess(width: float, new: Any = new) -> float:
            seat = new.structure_connector
            widths = seat.sources.half_width.copy()
            widths[seat.sources.names.index("ry")] = width
            own = replace(new, structure_connector=replace(seat, sources=replace(seat.sources, half_width=widths)))
            return score(own, losses=False).verdict.checks[0].value - 0.5

        assert found.cost_exact_law == pytest.approx(1 / brentq(excess, 1e-4, 0.1, xtol=1e-13), rel=close)
    assert costs[-30.0] < 0.8 * costs[0.0]


def test_a_quantile_of_nothing_is_a_number_of_the_record() -> None:
    """closed form: what always lies on the other side has a P95 of 0 on this one, known to 0 %."""
    data = copy.deepcopy(DEMO)
    data["requirements"] = [{"name": "above", "error": "z", "side": "above", "limit_mm": 1.0}]
    data.pop("optimise", None)
    seat = data["interfaces"]["structure_connector"]
    seat["bias"] = {**seat.get("bias", {}), "tz_mm": 9.0}
    check = verify(load_design(data), trials=2000)
    assert check.verdict.checks[0].value == 0
    assert json.dumps(check.to_dict(), allow_nan=False)
